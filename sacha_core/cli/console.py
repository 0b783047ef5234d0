"""What a command says: results on stdout, progress beside them, and the report for machines."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from sacha_core.cli.waiting import Bar, JsonLines, Nothing, PlainLines, Waiting
from sacha_core.files import write_aside
from sacha_core.progress import Progress

__all__ = ["Console", "counted", "kilobytes", "table", "write_report"]


class Console:
    """One command's voice.

    Results go to stdout. Progress goes to stderr as a bar, or, in mode `json`, to stdout as one object a line; then results are left out,
    so that a program that reads stdout meets JSON alone (`--json` gives it the report).

    Args:
        mode: what `--progress` says.
    """

    def __init__(self, mode: Literal["bar", "json", "none"]) -> None:
        self._speaks = mode != "json"
        self._waiting: Waiting
        if mode == "json":
            self._waiting = JsonLines()
        elif mode == "none":
            self._waiting = Nothing()
        else:
            self._waiting = Bar() if sys.stderr.isatty() else PlainLines()

    def __enter__(self) -> Console:
        """Begin a command."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was."""
        self._waiting.close()

    def report(self, progress: Progress) -> None:
        """Show how far a long job has come."""
        self._waiting.show(progress)

    def say(self, text: str = "") -> None:
        """Say a result."""
        if self._speaks:
            self._waiting.close()
            sys.stdout.write(f"{text}\n")
            sys.stdout.flush()

    def wrote(self, what: str, path: Path, note: str = "") -> None:
        """Say which file or folder was written, and what is worth knowing about it."""
        self.say(f"{what:12} {path}" + (f"  ({note})" if note else ""))

    def hint(self, *commands: str) -> None:
        """Say which commands one would call next."""
        self.say("\nnext:  " + "\n       ".join(commands))


def kilobytes(n_bytes: int) -> str:
    """Say a size in KB of 1000 bytes."""
    return f"{n_bytes / 1000:,.1f} KB"


def counted(n: int, noun: str) -> str:
    """Say how many there are of something: 1 frame, 1,000 frames."""
    return f"{n:,} {noun}{'s' * (n != 1)}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[int] = (0,)) -> str:
    """Set a table in plain text.

    Args:
        head: column titles.
        rows: cells, as many in each row as there are titles.
        words: columns that are left-aligned, as figures are not.
    """
    lines = [list(head), *map(list, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    set_lines = [
        "  ".join(
            cell.ljust(width) if i in words else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
    set_lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(line.rstrip() for line in set_lines)


def write_report(path: Path, report: Mapping[str, Any]) -> None:
    """Write what a command found as JSON, whole or not at all.

    Args:
        path: the file.
        report: names to plain values, arrays, or paths; figures that are not finite become null.
    """
    text = json.dumps(_plain(report), indent=2, allow_nan=False)
    with write_aside(path) as aside:
        aside.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """Give `value` in JSON's own types."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy's
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
