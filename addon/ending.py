# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a worker ended, from what it said, its exit status and its log. Knows nothing of Blender."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from . import told
from .engine import Disagreement, disagreement

__all__ = ["Ending", "Heard", "ending", "exit_status", "quoted"]

QUOTED_LINES = 40  # of a log, in diagnostics
LOOKED_AT_LINES = 20  # of a log, for what went wrong
BAD_INPUT = 2  # how the engine ends where it does not take what it is given
NO_ENGINE = ("No module named sacha_core", "No module named 'sacha_core'")


class Ending(NamedTuple):
    """What ended a worker that did not finish.

    Args:
        kind: of `advice.ADVICE`; empty where none is known.
        message: one line for the user.
    """

    kind: str
    message: str


@dataclass
class Heard:
    """What an engine says beside progress (`sacha_core/cli/protocol.py`).

    Args:
        hello: `engine`, its version, and `speaks`; None before it spoke, and for programs that do not.
        error: what ended it, as it said; None where it did not say.
        finished: it said that all its work is done and written.
    """

    hello: dict[str, Any] | None = None
    error: Ending | None = None
    finished: bool = False

    def line(self, line: bytes) -> bool:
        """Take in a line of the worker's; tell whether it was one of these."""
        try:
            said = json.loads(line)
            if "speaks" in said:
                self.hello = said
            elif "error" in said:
                self.error = Ending(str(said["error"]["kind"]), str(said["error"]["message"]))
            elif said.get("finished") is True:
                self.finished = True
            else:
                return False
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            return False  # a library of the worker printed something
        return True

    def disagreement(self) -> Disagreement | None:
        """Tell whether this is an engine that the add-on does not understand; one that has not spoken may still do so."""
        return None if self.hello is None else disagreement(self.hello)


def exit_status(code: int) -> str:
    """Name how a process ended."""
    return f"signal {-code}" if code < 0 else f"code {code}"


def ending(arguments: Sequence[Any], code: int, folder: Path, heard: Heard) -> Ending:
    """Say why a worker did not finish.

    Args:
        arguments: how it was called.
        code: its exit status; negative where a signal ended it.
        folder: the job's, with its log.
        heard: what it said.
    """
    lines = told.last_lines(folder / told.LOG, LOOKED_AT_LINES)
    wrong = heard.disagreement()
    if wrong is not None:
        return Ending(*wrong)
    return heard.error or _unsaid(arguments, code, lines)


def _unsaid(arguments: Sequence[Any], code: int, lines: list[str]) -> Ending:
    """Say why a worker ended that did not say so itself."""
    if any(sentence in line for line in lines for sentence in NO_ENGINE):
        return Ending("NoEngine", f"{arguments[0]} has no SACHA engine: install it there with pip")
    if code < 0:  # on POSIX: a signal that nobody here sent
        return Ending("EngineKilled", f"The engine was ended from outside ({exit_status(code)})")
    if not lines:
        return Ending("", f"The engine ended with {exit_status(code)} and said nothing")
    if code == BAD_INPUT and "sacha_core" in arguments and lines[-1].startswith("sacha"):
        return Ending(*disagreement(None))  # it ended as engines end, and was one from before the agreement
    return Ending("EngineBroken" if any(line.startswith("Traceback (") for line in lines) else "", lines[-1])


def quoted(arguments: Sequence[Any], code: int | None, folder: Path) -> str:
    """Give how a worker was called and the end of its log, for diagnostics."""
    status = "still running" if code is None else f"exit code {code}"
    lines = told.last_lines(folder / told.LOG, QUOTED_LINES)
    return "\n".join([shlex.join(map(str, arguments)), status, *lines])
