"""How fast the machine itself is while a bench runs: a small fixed workload, taken in turns with what is measured.

The same machine is not always as fast: processors change their clock, a virtual one shares its core and its memory with strangers. Two runs
can be compared once it is known how fast the machine was in each; this says it, in the time of two pieces of work that never change.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np

__all__ = ["PARTS", "Reference", "taken", "watched"]

PARTS = ("compute", "memory")
SMALL, PASSES = 4096, 400  # numbers that stay in the first-level cache, and how often they are gone through
LARGE = 6 << 20  # numbers that no core's own cache holds
EVERY_S = 0.25  # so that it costs some 2 % of a bench
ENDS = 5  # times that it is taken before and after
WARM_UP = 3

Times = dict[str, list[tuple[float, float]]]


class Reference:
    """A workload of two parts: arithmetic on numbers at hand, and copying from memory to memory. One thread.

    Attributes:
        times: (wall, processor) seconds of each part, one for each time that it was taken.
    """

    def __init__(self) -> None:
        self.times: Times = {part: [] for part in PARTS}
        self._numbers = np.linspace(1, 2, SMALL, dtype=np.float32)
        self._product = np.empty_like(self._numbers)
        self._source = np.ones(LARGE, np.float32)
        self._copy = np.zeros_like(self._source)
        self._taken = -np.inf
        for _ in range(WARM_UP):
            self._compute()
            self._move()

    def take(self, times: int = 1) -> None:
        """Do the work so many times."""
        for _ in range(times):
            for part, work in zip(PARTS, (self._compute, self._move), strict=True):
                wall, busy = time.perf_counter(), time.thread_time()
                work()
                self.times[part].append((time.perf_counter() - wall, time.thread_time() - busy))
        self._taken = time.perf_counter()

    def take_when_due(self) -> None:
        """Do the work once, unless that was a moment ago."""
        if time.perf_counter() - self._taken >= EVERY_S:
            self.take()

    def row(self) -> dict[str, Any]:
        """Give each part's median, tenth and ninetieth percentile of wall time and median of processor time (ms), and how often."""
        found: dict[str, Any] = {"samples": len(self.times[PARTS[0]])}
        for part, pairs in self.times.items():
            wall, busy = 1e3 * np.array(pairs).T
            low, middle, high = np.quantile(wall, (0.1, 0.5, 0.9))
            found |= {f"{part}_ms": float(middle), f"{part}_low_ms": float(low), f"{part}_high_ms": float(high)}
            found[f"{part}_busy_ms"] = float(np.median(busy))
        return found

    def _compute(self) -> None:
        for _ in range(PASSES):
            np.multiply(self._numbers, self._numbers, out=self._product)
            np.sqrt(self._product, out=self._product)
            np.divide(self._product, self._numbers, out=self._product)

    def _move(self) -> None:
        np.copyto(self._copy, self._source)


_present: ContextVar[Reference | None] = ContextVar("reference", default=None)


@contextmanager
def watched() -> Iterator[Reference]:
    """Take the reference before and after a bench, and where the bench says that it may be taken (`taken`)."""
    reference = Reference()
    reference.take(ENDS)
    token = _present.set(reference)
    try:
        yield reference
    finally:
        _present.reset(token)
        reference.take(ENDS)


def taken() -> None:
    """Take the reference if somebody watches, and it is due."""
    reference = _present.get()
    if reference is not None:
        reference.take_when_due()
