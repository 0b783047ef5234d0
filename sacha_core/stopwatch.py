"""How long the stages of a job take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

__all__ = ["Stopwatch", "Timer", "timed"]

NOBODY = nullcontext()
Timer = Callable[
    [str], AbstractContextManager[None]
]  # measures the time spent inside, for a stage; a `Stopwatch` is one


class Stopwatch:
    """Adds up the seconds that stages take, each without the stages inside it. For one thread.

    Attributes:
        seconds: by stage, in the order in which they first began.
        counts: how often each was measured.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.counts: dict[str, int] = {}
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Measure the time spent inside."""
        self.seconds.setdefault(stage, 0.0)
        self.counts[stage] = self.counts.get(stage, 0) + 1
        self._settle()
        self._running.append(stage)
        try:
            yield
        finally:
            self._settle()
            self._running.pop()

    def tell(self, stage: str, seconds: float) -> None:
        """Count time that was measured elsewhere for a stage, and so not for the one that is running."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        if self._running:
            self.seconds[self._running[-1]] -= seconds

    def _settle(self) -> None:
        """Give the time since the last change to the stage that was running."""
        now = time.perf_counter()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since
        self._since = now


def timed(watch: Timer | None, stage: str) -> AbstractContextManager[None]:
    """Measure the time spent inside, where somebody wants to know."""
    return NOBODY if watch is None else watch(stage)
