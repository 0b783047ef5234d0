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
    """Adds up the seconds that stages take; stages inside one another both count.

    Attributes:
        seconds: by stage, in the order in which they first began.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Measure the time spent inside."""
        self.seconds.setdefault(stage, 0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start


def timed(watch: Timer | None, stage: str) -> AbstractContextManager[None]:
    """Measure the time spent inside, where somebody wants to know."""
    return NOBODY if watch is None else watch(stage)
