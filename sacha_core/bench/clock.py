"""Timing several candidates against each other: turn by turn in one process, so that what slows the machine slows them all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from sacha_core.bench import reference

__all__ = ["AGAIN", "LEAST_ROUNDS", "Clock", "Times", "interleave", "is_median"]

K = TypeVar("K")
LEAST_ROUNDS = 3  # of which a median and quartiles can be taken at all
AGAIN = "_again_ms"  # how keys end that say what a time was when its bench was run once more
SPREAD = ("_min_ms", "_q1_ms", "_q3_ms", "_busy_ms", AGAIN)  # of a time, not times of their own


@dataclass(frozen=True)
class Clock:
    """Two clocks: what a caller waits for, and what the work costs, which other processes on the same cores change less.

    Args:
        wall: seconds from any origin.
        busy: seconds of processor time of this process, all its threads together.
    """

    wall: Callable[[], float] = time.perf_counter
    busy: Callable[[], float] = time.process_time


@dataclass(frozen=True)
class Times:
    """Times of one candidate, one of each round.

    Args:
        wall_s: (r,) seconds that a caller waits.
        busy_s: (r,) seconds of processor time.
    """

    wall_s: Float[np.ndarray, " r"]
    busy_s: Float[np.ndarray, " r"]

    @property
    def median_ms(self) -> float:
        """Median of wall time, milliseconds."""
        return 1e3 * float(np.median(self.wall_s))

    def row(self, name: str) -> dict[str, float]:
        """Give the figures under the names of a row.

        Args:
            name: of what was timed, such as `forward`.

        Returns:
            Milliseconds: of wall time `NAME_ms` (median), `NAME_min_ms`, `NAME_q1_ms` and `NAME_q3_ms` (quartiles, left out where there
            were too few rounds); of processor time `NAME_busy_ms` (median).
        """
        low, middle, high = (1e3 * float(q) for q in np.quantile(self.wall_s, (0.25, 0.5, 0.75)))
        found = {f"{name}_ms": middle, f"{name}_min_ms": 1e3 * float(self.wall_s.min())}
        if len(self.wall_s) >= LEAST_ROUNDS:
            found |= {f"{name}_q1_ms": low, f"{name}_q3_ms": high}
        return found | {f"{name}_busy_ms": 1e3 * float(np.median(self.busy_s))}

    def __add__(self, other: Times) -> Times:
        """Give what both took together, round by round."""
        return Times(self.wall_s + other.wall_s, self.busy_s + other.busy_s)


def is_median(key: str) -> bool:
    """Tell whether a key of a row names a time by the wall, not what `Times.row` says of one besides."""
    return key.endswith("_ms") and not key.endswith(SPREAD)


def interleave(
    candidates: Mapping[K, Callable[[], object]],
    rounds: int = 9,
    budget_s: float = float("inf"),
    warm_up: int = 1,
    least: int = LEAST_ROUNDS,
    clock: Clock | None = None,
) -> dict[K, Times]:
    """Time every candidate once a round, beginning each round with another one; before a round, the reference where it is due.

    Args:
        candidates: what to call, without arguments.
        rounds: how many rounds, unless time runs out.
        budget_s: no further round begins after so many seconds.
        warm_up: calls of each candidate before the first round, not timed: compiling, and memory touched for the first time.
        least: rounds that are run however long they take; with fewer than three there are no quartiles.
        clock: what tells the time.

    Returns:
        The times of each candidate, under its name.
    """
    clock = clock or Clock()
    names = list(candidates)
    for name in names:
        for _ in range(warm_up):
            candidates[name]()
    times: dict[K, list[tuple[float, float]]] = {name: [] for name in names}
    begun = clock.wall()
    for k in range(max(rounds, least)):
        if k >= least and clock.wall() - begun >= budget_s:
            break
        reference.taken()
        first = k % max(len(names), 1)
        for name in names[first:] + names[:first]:
            wall, busy = clock.wall(), clock.busy()
            candidates[name]()
            times[name].append((clock.wall() - wall, clock.busy() - busy))
    return {name: Times(*np.array(pairs).T) for name, pairs in times.items()}
