"""The order in which Gaussians are coded, and what each is predicted from; both sides derive it from the counts alone.

The *first* Gaussian of each occupied triangle is coded coarse to fine: every 2^L-th triangle, then the ones half way between,
each predicted from its two neighbours already known. The further Gaussians of a triangle, its *mates*, follow rank by rank (ranks
1, 2, 3, 4-5, 6-7, 8-11, ... make one pass each), predicted from the mean of all earlier ones in the triangle. So a pass is a handful
of array operations, and their number grows with the logarithm of the counts.

Source: own; coarse to fine as in lifting schemes (Sweldens, 1996).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int

from sacha_core.codec.template import Template

__all__ = ["KINDS", "MATES", "Layout", "Pass", "mean_of_mates"]

COARSE, FINE, FINEST, MATES = 0, 1, 2, 3
KINDS = 4


@dataclass(frozen=True)
class Pass:
    """Gaussians that are coded together.

    Args:
        kind: COARSE, FINE, FINEST (firsts, by distance to their neighbours) or MATES.
        rows: (p,) the Gaussians, ascending.
        left: (p,) for firsts the row of the neighbour before; equal to `rows` where nothing is known yet.
        right: (p,) for firsts the row of the neighbour behind (the one before where there is none).
        slot: (p,) for mates the occupied triangle, counted from 0.
        rank: (p,) rank of each in its triangle.
    """

    kind: int
    rows: Int[np.ndarray, " p"]
    left: Int[np.ndarray, " p"]
    right: Int[np.ndarray, " p"]
    slot: Int[np.ndarray, " p"]
    rank: Int[np.ndarray, " p"]


@dataclass(frozen=True)
class Layout:
    """Where the n Gaussians lie, sorted by triangle in coding order.

    Args:
        counts: (f,) Gaussians on each triangle, in coding order.
        template: coding order and sizes of the triangles.
    """

    counts: Int[np.ndarray, " f"]
    template: Template

    @cached_property
    def binding(self) -> Int[np.ndarray, " n"]:
        """Triangle of each Gaussian."""
        return np.repeat(self.template.order.astype(np.int32), self.counts)

    @cached_property
    def triangle_size(self) -> Int[np.ndarray, " n"]:
        """Size class of each Gaussian's triangle, half octaves."""
        return np.repeat(self.template.size, self.counts)

    @cached_property
    def occupied_counts(self) -> Int[np.ndarray, " m"]:
        """Gaussians on each occupied triangle."""
        return self.counts[self.counts > 0].astype(np.int64)

    @cached_property
    def firsts(self) -> Int[np.ndarray, " m"]:
        """Row of the first Gaussian of each occupied triangle."""
        return np.asarray(np.cumsum(self.occupied_counts) - self.occupied_counts)

    @cached_property
    def slots(self) -> Int[np.ndarray, " n"]:
        """Occupied triangle of each Gaussian, counted from 0."""
        return np.repeat(np.arange(len(self.firsts)), self.occupied_counts)

    @cached_property
    def ranks(self) -> Int[np.ndarray, " n"]:
        """Rank of each Gaussian in its triangle."""
        return np.asarray(np.arange(len(self.slots)) - self.firsts[self.slots])

    @cached_property
    def passes(self) -> tuple[Pass, ...]:
        """All passes, in coding order; together they hold every Gaussian once."""
        return (*self._passes_of_firsts(), *self._passes_of_mates())

    def _passes_of_firsts(self) -> Iterator[Pass]:
        m = len(self.firsts)
        if m == 0:
            return
        stride = 1 << max(m - 1, 0).bit_length()
        origin = self.firsts[:1]
        yield Pass(COARSE, origin, origin, origin, np.zeros(1, np.int64), np.zeros(1, np.int64))
        while stride > 1:
            half = stride // 2
            middle = np.arange(half, m, stride)
            behind = np.where(middle + half < m, middle + half, middle - half)
            kind = {1: FINEST, 2: FINE}.get(half, COARSE)
            if len(middle):
                rows = self.firsts[middle]
                yield Pass(kind, rows, self.firsts[middle - half], self.firsts[behind], middle, np.zeros_like(middle))
            stride = half

    def _passes_of_mates(self) -> Iterator[Pass]:
        most = int(self.occupied_counts.max(initial=0))
        by_rank = np.argsort(self.ranks, kind="stable")
        ends = np.searchsorted(self.ranks[by_rank], np.arange(most + 1))
        low = 1
        while low < most:
            width = max(1, (1 << (low.bit_length() - 1)) // 2)
            rows = np.sort(by_rank[ends[low] : ends[min(low + width, most)]])
            yield Pass(MATES, rows, rows, rows, self.slots[rows], self.ranks[rows])
            low += width


def mean_of_mates(sums: Int[np.ndarray, "m c"], counts: Int[np.ndarray, " m"]) -> Int[np.ndarray, "m c"]:
    """Mean rounded to the nearest integer, halves up."""
    twice = 2 * counts[:, None]
    return np.asarray((2 * sums + counts[:, None]) // twice)
