"""What a program that drives `sacha` is told beside progress: who speaks, and what kind of failure ended a command.

With `--progress json` the first line on stdout is `{"engine": "0.1.0", "speaks": [1, 1]}`: the version, and the lowest and the highest
number of the agreement between the Blender add-on and the engine that this engine keeps. The number rises when commands, options or
files that the add-on uses change so that an older partner would misread them. The last line of a command that failed is
`{"error": {"kind": "MissingHeadError", "message": "..."}}`, where the kind is the error's class and the message the line on stderr.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from itertools import pairwise

from sacha_core import __version__

__all__ = ["SPEAKS", "say_error", "say_hello", "wanted"]

SPEAKS = (1, 1)


def wanted(arguments: Sequence[str]) -> bool:
    """Tell whether the caller reads progress as JSON, before the arguments have been understood: they may be of another version."""
    return "--progress=json" in arguments or ("--progress", "json") in pairwise(arguments)


def say_hello() -> None:
    """Say which engine this is."""
    _say({"engine": __version__, "speaks": SPEAKS})


def say_error(error: BaseException, message: str) -> None:
    """Say what ended the command.

    Args:
        error: what was raised; its class is the kind.
        message: what it means to the user, on one line.
    """
    _say({"error": {"kind": type(error).__name__, "message": message}})


def _say(line: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()
