"""Showing someone who waits how far a long job has come: a bar, JSON lines, or nothing."""

from __future__ import annotations

import json
import math
import sys
import time
from typing import TYPE_CHECKING, Protocol

from sacha_core.progress import Progress

if TYPE_CHECKING:
    from rich.progress import TaskID

__all__ = ["Bar", "JsonLines", "Nothing", "PlainLines", "TimeLeft", "Waiting", "duration"]

SECONDS_BETWEEN_LINES = 15.0  # in a log file one line now and then is enough
MOST_BARS = 12  # of which finished ones make room for new ones
COUNT_WIDTH = 13  # columns: 360000/360000
SECONDS_BETWEEN_OBJECTS = 0.1  # a program that reads every step would do little else


class Waiting(Protocol):
    """One way of showing progress."""

    def show(self, progress: Progress) -> None:
        """Show one step."""

    def close(self) -> None:
        """Leave the terminal as it was."""


class TimeLeft:
    """Guesses how long a stage will still take, from its pace since its first report (a resumed job starts in the middle).

    Several stages may be on at once; one that falls back begins anew.
    """

    def __init__(self) -> None:
        self._begun: dict[str, tuple[float, int]] = {}
        self._last: dict[str, int] = {}

    def seconds(self, progress: Progress) -> float | None:
        """Give the seconds left in this stage; None while there is no pace to go by."""
        now, stage = time.monotonic(), progress.stage
        if stage not in self._begun or progress.done < self._last[stage]:
            self._begun[stage] = (now, progress.done)
        self._last[stage] = progress.done
        since, first = self._begun[stage]
        steps = progress.done - first
        if progress.done >= progress.total:
            return 0.0
        return (now - since) / steps * (progress.total - progress.done) if steps > 0 else None


class Nothing:
    """Shows nothing."""

    def show(self, progress: Progress) -> None:
        """Show nothing."""

    def close(self) -> None:
        """Nothing was opened."""


class JsonLines:
    """One JSON object a line on stdout: stage, done, total, seconds_left (null while unknown), values."""

    def __init__(self) -> None:
        self._left = TimeLeft()
        self._written: dict[str, float] = {}

    def show(self, progress: Progress) -> None:
        """Write one object; steps that follow within a tenth of a second are left out, ends of stages never."""
        left = self._left.seconds(progress)
        now = time.monotonic()
        recent = now - self._written.get(progress.stage, -math.inf) < SECONDS_BETWEEN_OBJECTS
        if recent and progress.done < progress.total:
            return
        self._written[progress.stage] = now
        line = {
            "stage": progress.stage,
            "done": progress.done,
            "total": progress.total,
            "seconds_left": None if left is None else round(left, 1),
            "values": {name: value if math.isfinite(value) else None for name, value in progress.values.items()},
        }
        sys.stdout.write(json.dumps(line, allow_nan=False) + "\n")
        sys.stdout.flush()

    def close(self) -> None:
        """Nothing was opened."""


class PlainLines:
    """A line of text on stderr now and then for each stage: what a bar becomes where stderr is no terminal."""

    def __init__(self) -> None:
        self._left = TimeLeft()
        self._written: dict[str, float] = {}

    def show(self, progress: Progress) -> None:
        """Write one line if the stage's last, or its beginning, is long enough ago."""
        left = self._left.seconds(progress)
        now = time.monotonic()
        if now - self._written.setdefault(progress.stage, now) < SECONDS_BETWEEN_LINES:
            return
        self._written[progress.stage] = now
        pace = "" if left is None else f", {_left(left)}"
        sys.stderr.write(f"{progress.stage} {progress.done}/{progress.total}{pace}{_values(progress)}\n")
        sys.stderr.flush()

    def close(self) -> None:
        """Nothing was opened."""


class Bar:
    """A bar for each stage, with the time left and the stage's figures."""

    def __init__(self) -> None:
        from rich.console import Console as Terminal
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as RichProgress
        from rich.table import Column

        self._left = TimeLeft()
        self._bars = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            TextColumn(
                "{task.completed:.0f}/{task.total:.0f}", table_column=Column(no_wrap=True, min_width=COUNT_WIDTH)
            ),
            TextColumn("{task.fields[note]}", table_column=Column(no_wrap=True, overflow="ellipsis")),
            console=Terminal(stderr=True),
        )
        self._tasks: dict[str, TaskID] = {}

    def show(self, progress: Progress) -> None:
        """Draw one step."""
        note = _left(self._left.seconds(progress)) + _values(progress)
        if progress.stage not in self._tasks:
            self._bars.start()
            self._make_room()
            self._tasks[progress.stage] = self._bars.add_task(progress.stage, total=progress.total, note=note)
        self._bars.update(self._tasks[progress.stage], completed=progress.done, total=progress.total, note=note)

    def _make_room(self) -> None:
        """Take finished stages off, the oldest first, where there are many."""
        finished = {task.id for task in self._bars.tasks if task.finished}
        for stage, task in list(self._tasks.items()):
            if len(self._tasks) >= MOST_BARS and task in finished:
                self._bars.remove_task(task)
                del self._tasks[stage]

    def close(self) -> None:
        """Stop drawing; finished bars stay to be read."""
        self._bars.stop()


def duration(seconds: float) -> str:
    """Say a length of time: `8 s`, `3 min 20 s`, `2 h 05 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _left(seconds: float | None) -> str:
    if seconds == 0:
        return "done"
    return "" if seconds is None else f"{duration(seconds)} left"


def _values(progress: Progress) -> str:
    return "".join(
        f"  {name.replace('_per_', '/').replace('_', ' ')} {_figure(v)}" for name, v in progress.values.items()
    )


def _figure(value: float) -> str:
    return f"{value:,.0f}" if value == round(value, 0) else f"{value:.3g}"
