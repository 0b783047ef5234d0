# SPDX-License-Identifier: GPL-3.0-or-later
"""What a worker says of itself: lines of progress, its log, its report. Anything may stand in them. Knows nothing of Blender."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

__all__ = ["LOG", "PRINTED", "REPORT", "Told", "duration", "last_lines", "last_told", "parse_line", "read_report"]

PRINTED, LOG, REPORT = (
    "printed.jsonl",
    "log.txt",
    "report.json",
)  # stdout, stderr, and the command's report, in a worker's folder
TAIL_BYTES = 16_384  # of a file of which only the end is wanted
LONGEST_STAGE = 120  # characters: more is no name of a stage
LARGEST = 1 << 62
MINUTE_S, HOUR_S = 60, 3600


@dataclass(frozen=True)
class Told:
    """One line of progress.

    Args:
        stage: what is being done, in the worker's words.
        done: steps of that stage finished.
        total: steps of that stage.
        seconds_left: in that stage; None while unknown.
        values: figures worth showing, by name.
    """

    stage: str = ""
    done: int = 0
    total: int = 0
    seconds_left: float | None = None
    values: dict[str, float] = field(default_factory=dict)

    @property
    def fraction(self) -> float:
        """Part of the stage that is done, 0 to 1."""
        return min(max(self.done / self.total, 0.0), 1.0) if self.total > 0 else 0.0

    @property
    def left(self) -> str:
        """The time left in the stage, for people; empty while unknown or nothing."""
        return f"{duration(self.seconds_left)} left" if self.seconds_left else ""

    @property
    def figures(self) -> str:
        """The figures, for people."""
        return ", ".join(
            f"{name.replace('_per_', '/').replace('_', ' ')} {value:,.6g}" for name, value in self.values.items()
        )


def parse_line(line: bytes) -> Told | None:
    """Read one line that a worker printed; None where it is no progress, but something that a library said."""
    try:
        said = json.loads(line)
        stage, done, total = str(said["stage"]), int(said["done"]), int(said["total"])
        left, values = said.get("seconds_left"), said.get("values") or {}
        figures = {str(name): float(value) for name, value in values.items() if _is_number(value)}
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    if len(stage) > LONGEST_STAGE or not (-LARGEST < done < LARGEST and -LARGEST < total < LARGEST):
        return None
    return Told(stage, done, total, max(float(left), 0.0) if _is_number(left) else None, figures)


def last_told(path: Path) -> Told:
    """Give the last line of progress in a file that may be long, or still be written; nothing told where there is none."""
    for line in reversed(_tail(path).split(b"\n")[:-1]):  # what comes after the last line break is not whole yet
        told = parse_line(line)
        if told is not None:
            return told
    return Told()


def last_lines(path: Path, n: int) -> list[str]:
    """Give the last lines of a log that say something; none where there is no log."""
    lines = [line.strip() for line in _tail(path).decode("utf-8", errors="replace").splitlines()]
    return [line for line in lines if line][-n:]


def read_report(path: Path) -> dict[str, Any]:
    """Read the report of a command.

    Raises:
        ValueError: it left none, or one that is no report; in one sentence.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"The engine ended well but left no {path.name}: is its version that of the add-on?") from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"The engine left a {path.name} that cannot be read ({error})") from error
    if not isinstance(report, dict):
        raise ValueError(f"The engine left a {path.name} that is no report, but {type(report).__name__}")  # noqa: TRY004  (users read it)
    return report


def duration(seconds: float) -> str:
    """Say a length of time: `8 s`, `3 min 20 s`, `2 h 05 min`."""
    whole = round(seconds)
    if whole < MINUTE_S:
        return f"{whole} s"
    if whole < HOUR_S:
        return f"{whole // MINUTE_S} min {whole % MINUTE_S:02d} s"
    return f"{whole // HOUR_S} h {whole % HOUR_S // MINUTE_S:02d} min"


def _is_number(value: object) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST and math.isfinite(value)
    )


def _tail(path: Path) -> bytes:
    """Give the end of a file; nothing where there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - TAIL_BYTES))
            return file.read(TAIL_BYTES)
    except FileNotFoundError:
        return b""
