# SPDX-License-Identifier: GPL-3.0-or-later
"""The last thing that went wrong: said in the report, kept for the sidebar and for diagnostics."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import bpy

from .advice import advice, in_blender

__all__ = ["Problem", "forget", "last", "tell"]


@dataclass(frozen=True)
class Problem:
    """One thing that went wrong.

    Args:
        kind: of `advice.ADVICE`, or empty.
        message: what was wrong, where, and what was expected.
        title: what was being done.
        log: the end of what the engine wrote, and how it was called; empty where it was not.
        at: when, in local time.
    """

    kind: str
    message: str
    title: str = ""
    log: str = ""
    at: str = field(default_factory=lambda: time.strftime("%Y-%m-%d %H:%M:%S"))

    @property
    def advice(self) -> str:
        """What to do; empty where the message alone says it."""
        return advice(self.kind)

    @property
    def sentence(self) -> str:
        """What was wrong and what to do, in one line."""
        end = "" if not self.advice or self.message.endswith((".", "!", "?")) else "."
        return f"{self.message}{end} {self.advice}".strip()


_last: list[Problem] = []  # one at most


def last() -> Problem | None:
    """Give the last problem, if nothing has gone well since."""
    return _last[0] if _last else None


def forget() -> None:
    """It is solved, or the user has read it."""
    _last.clear()


def tell(operator: bpy.types.Operator, message: str, kind: str = "", *, title: str = "", log: str = "") -> set[str]:
    """Report an error with what to do about it, and keep it for the sidebar.

    Args:
        operator: whose error it is.
        message: what was wrong, where, and what was expected.
        kind: of `advice.ADVICE`; where empty, the message says what to do.
        title: what was being done; the operator's label where empty.
        log: the end of what the engine wrote.

    Returns:
        What the operator returns: `return tell(self, ...)`.
    """
    problem = Problem(kind, in_blender(message), title or operator.bl_label, log)
    _last[:] = [problem]
    operator.report({"ERROR"}, problem.sentence)
    return {"CANCELLED"}
