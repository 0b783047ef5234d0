"""How many Gaussians each region may keep, by its share of what stays and by its lock, and who they are.

Source: own. Of the sets of a size in which every region has a number within bounds, the greedy choice is best: each region's own best up to
its least number, then the best of all whose region has room (a laminar matroid).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, Integer

from sacha_core.density.budget import Budget
from sacha_core.errors import OptionError

__all__ = ["Limits", "best_within", "limits_of", "nearest_possible"]

ROUNDING = 1e-9  # 0.1 of 30 is 3, though it is a little more in binary


@dataclass(frozen=True)
class Limits:
    """Least and most Gaussians of each of r regions, for each of m totals.

    Args:
        total: (m,) Gaussians that stay.
        there: (r,) Gaussians that there are.
        lowest: (m, r) each region's least.
        highest: (m, r) each region's most; below `lowest` where a region has too few for its share.
    """

    total: Int[np.ndarray, " m"]
    there: Int[np.ndarray, " r"]
    lowest: Int[np.ndarray, "m r"]
    highest: Int[np.ndarray, "m r"]

    @property
    def possible(self) -> Bool[np.ndarray, " m"]:
        """Which of the totals can be had."""
        fits = np.all(self.lowest <= self.highest, axis=1)
        within = (self.lowest.sum(axis=1) <= self.total) & (self.total <= self.highest.sum(axis=1))
        return np.asarray(fits & within)


def limits_of(total: Int[np.ndarray, " m"], there: Int[np.ndarray, " r"], budget: Budget) -> Limits:
    """Give the limits that a budget sets.

    Args:
        total: (m,) Gaussians that may stay.
        there: (r,) Gaussians that each region has.
        budget: with shares and locks.
    """
    lowest = np.zeros((len(total), len(there)), np.int64)
    highest = np.broadcast_to(there, lowest.shape).copy()
    for label, (least, most) in budget.shares.items():
        lowest[:, label] = np.ceil(least * total - ROUNDING)
        highest[:, label] = np.minimum(np.floor(most * total + ROUNDING), there[label])
    for label, count in budget.locks.items():
        locked = int(there[label]) if count is None else min(count, int(there[label]))
        lowest[:, label] = highest[:, label] = locked
    return Limits(total, there, lowest, highest)


def nearest_possible(wanted: int, there: Int[np.ndarray, " r"], budget: Budget) -> int:
    """Give the number of Gaussians nearest to the wanted one that a budget's shares and locks leave possible; of two the larger.

    Raises:
        OptionError: none is.
    """
    total = np.arange(1, int(there.sum()) + 1)
    possible = total[limits_of(total, there, budget).possible]
    if not len(possible):
        raise OptionError("no number of Gaussians meets all shares and locks together; expected fewer or wider ones")
    return int(possible[::-1][np.argmin(np.abs(possible[::-1] - wanted))])


def require_possible(limits: Limits, names: tuple[str, ...], budget: Budget) -> None:
    """Check that the one total of `limits` can be had.

    Raises:
        OptionError: it cannot; the message says what stands in its way.
    """
    total, lowest, highest = int(limits.total[0]), limits.lowest[0], limits.highest[0]
    for label, name in enumerate(names):
        if lowest[label] > limits.there[label]:
            raise OptionError(
                f"{name} has {limits.there[label]:,} Gaussians, and a share of {budget.shares[label][0]:g} of {total:,} is"
                f" {lowest[label]:,}; expected a smaller one"
            )
        if lowest[label] > highest[label]:
            least, most = budget.shares[label]
            raise OptionError(
                f"no number of Gaussians is {least:g} to {most:g} of {total:,}; expected wider bounds for {name}"
            )
    if lowest.sum() > total:
        raise OptionError(
            f"smallest shares and locks ask for {int(lowest.sum()):,} Gaussians, but {total:,} shall stay; expected less of them, or a"
            " larger budget"
        )
    if highest.sum() < total:
        raise OptionError(
            f"largest shares and locks allow for {int(highest.sum()):,} Gaussians, but {total:,} shall stay; expected wider ones, or a"
            " smaller budget"
        )


def best_within(
    order: Int[np.ndarray, " n"], regions: Integer[np.ndarray, " n"], limits: Limits
) -> Bool[np.ndarray, " n"]:
    """Mark the best Gaussians, as many as shall stay, so that each region has a number within its limits.

    Args:
        order: (n,) rows from worst to best.
        regions: (n,) region of each Gaussian.
        limits: of one total, which is possible.
    """
    best_first = order[::-1]
    of = regions[best_first]
    place = np.empty(len(of), np.int64)  # of each among its region's own, the best at 0
    by_region = np.argsort(of, kind="stable")
    starts = np.cumsum(limits.there) - limits.there
    place[by_region] = np.arange(len(of)) - starts[of[by_region]]
    sure, allowed = place < limits.lowest[0][of], place < limits.highest[0][of]
    more = np.flatnonzero(allowed & ~sure)[: int(limits.total[0]) - int(sure.sum())]
    sure[more] = True
    keep = np.zeros(len(of), bool)
    keep[best_first[sure]] = True
    return keep
