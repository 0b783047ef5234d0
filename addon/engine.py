# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine: which Python has it, and the commands that the add-on gives to it. Knows nothing of Blender."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

__all__ = [
    "SPEAKS",
    "Disagreement",
    "EngineMissingError",
    "command",
    "describe",
    "disagreement",
    "find_python",
    "probe",
]

VARIABLE = "SACHA_ENGINE"

SPEAKS = 1  # number of the agreement with the engine: `sacha_core/cli/protocol.py`, which see

# Runs in the engine's Python, which may lack everything: it must answer even then.
PROBE = """
import importlib.metadata as m, json, platform
def version(name):
    try: return m.version(name)
    except m.PackageNotFoundError: return None
found = {"python": platform.python_version(), **{n: version(n) for n in ("sacha", "numba", "constriction")}}
try:
    from sacha_core import __file__, __version__
    found |= {"sacha": __version__, "folder": __file__}
    from sacha_core.cli.protocol import SPEAKS
    found["speaks"] = SPEAKS
except ImportError: pass
print(json.dumps(found))
"""


class EngineMissingError(Exception):
    """No usable Python is named; the message says how to name one.

    Args:
        message: for the user.
        kind: of `advice.ADVICE`.
    """

    def __init__(self, message: str, kind: str = "NoEngine") -> None:
        super().__init__(message)
        self.kind = kind


def find_python(named: str) -> Path:
    """Give the Python that runs the engine: the one named in the preferences, else the one in SACHA_ENGINE.

    Args:
        named: what the preferences say, absolute; empty where nothing was chosen.

    Raises:
        EngineMissingError: none is named, or what is named is no file.
    """
    choice = named or os.environ.get(VARIABLE, "")
    if not choice:
        raise EngineMissingError("No SACHA engine: name the Python that has it in the add-on's preferences")
    if not Path(choice).is_file():
        raise EngineMissingError(
            f"No SACHA engine at {choice}: name the Python that has it in the add-on's preferences"
        )
    return Path(choice)


def command(python: Path, *arguments: str | os.PathLike[str]) -> list[str]:
    """Give the command line of one engine command that reports its progress line by line."""
    return [str(python), "-m", "sacha_core", *map(os.fspath, arguments), "--progress", "json"]


def probe(python: Path) -> list[str]:
    """Give the command line that asks a Python what it has; it prints one JSON object."""
    return [str(python), "-c", PROBE]


def describe(printed: str) -> str:
    """Say in a sentence what the probe found.

    Args:
        printed: what the probe wrote.

    Raises:
        EngineMissingError: this Python has no engine, or one that this add-on does not understand.
    """
    try:
        found = json.loads(printed.strip().splitlines()[-1])
        python = f"Python {found['python']}"
    except (ValueError, LookupError, TypeError) as error:
        raise EngineMissingError("What is named as the engine's Python is none: it gave no answer") from error
    if found["sacha"] is None:
        raise EngineMissingError(f"{python} without SACHA: install it there with pip")
    missing = [name for name in ("numba", "constriction") if found[name] is None]
    if missing:
        raise EngineMissingError(f"{python} with SACHA {found['sacha']}, but without {' and '.join(missing)}")
    wrong = disagreement({"engine": found["sacha"], "speaks": found.get("speaks")})
    if wrong is not None:
        raise EngineMissingError(wrong.message, wrong.kind)
    return f"{python}, SACHA {found['sacha']}"


class Disagreement(NamedTuple):
    """Why add-on and engine do not understand each other.

    Args:
        kind: "EngineTooOld" or "EngineTooNew".
        message: for the user.
    """

    kind: str
    message: str


def disagreement(hello: dict[str, Any] | None) -> Disagreement | None:
    """Compare what an engine says of itself with what this add-on needs; None where they agree.

    Args:
        hello: `engine`, its version, and `speaks`, the lowest and highest agreement that it keeps; None where it said nothing.
    """
    hello = hello or {}
    try:
        lowest, highest = map(int, hello["speaks"])
    except (LookupError, TypeError, ValueError):
        lowest = highest = 0  # before there was an agreement
    named = f"SACHA {hello['engine']}" if hello.get("engine") else "The SACHA engine"
    if highest < SPEAKS:
        return Disagreement("EngineTooOld", f"{named} is too old for this add-on")
    if lowest > SPEAKS:
        return Disagreement("EngineTooNew", f"{named} is too new for this add-on")
    return None
