"""The order in which Gaussians are coded, and what each is predicted from; both sides derive it before any attribute is known.

The *first* Gaussian of each occupied triangle is coded coarse to fine: every 2^L-th triangle, then the ones half way between,
each predicted from neighbours already known. The further Gaussians of a triangle, its *mates*, follow rank by rank (ranks
1, 2, 3, 4-5, 6-7, 8-11, ... make one pass each), predicted from the ones before in the triangle as well. So a pass is a handful
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

__all__ = ["FULL_TRUST", "KINDS", "MATES", "TRUST_BITS", "Layout", "Pass", "weighted_mean"]

COARSE, FINE, FINEST, MATES = 0, 1, 2, 3
KINDS = 4
TRUST_BITS = 6
FULL_TRUST = 1 << TRUST_BITS  # what the trust in a Gaussian's neighbours adds up to, where it has any
MATES_SEEN = 4


@dataclass(frozen=True)
class Pass:
    """Gaussians that are coded together.

    Args:
        kind: COARSE, FINE, FINEST (firsts, by distance to their neighbours) or MATES.
        rows: (p,) the Gaussians, ascending.
        near: (p, k) rows of Gaussians nearby that are known before the pass.
        trust: (p, k) weight of each; 0 where there is none, `FULL_TRUST` in all or, for a Gaussian without neighbours, 0.
        mates: (p, j) rows of earlier Gaussians of the same triangle, the last first.
        mate_trust: (p, j) likewise.
        slot: (p,) occupied triangle of each, counted from 0.
        rank: (p,) rank of each in its triangle.
    """

    kind: int
    rows: Int[np.ndarray, " p"]
    near: Int[np.ndarray, "p k"]
    trust: Int[np.ndarray, "p k"]
    mates: Int[np.ndarray, "p j"]
    mate_trust: Int[np.ndarray, "p j"]
    slot: Int[np.ndarray, " p"]
    rank: Int[np.ndarray, " p"]


def weighted_mean(
    values: Int[np.ndarray, "n ..."], rows: Int[np.ndarray, "p k"], trust: Int[np.ndarray, "p k"]
) -> Int[np.ndarray, "p ..."]:
    """Mean of the values at `rows` by trust, halves up; 0 where there is no trust."""
    weight = trust.reshape(trust.shape + (1,) * (values.ndim - 1))
    return np.asarray(((values[rows] * weight).sum(axis=1) + FULL_TRUST // 2) >> TRUST_BITS)


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
        yield self._first_pass(COARSE, np.zeros(1, np.int64), np.zeros((1, 2), np.int64), 0)
        stride = 1 << max(m - 1, 0).bit_length()
        while stride > 1:
            half = stride // 2
            middle = np.arange(half, m, stride)
            behind = np.where(middle + half < m, middle + half, middle - half)
            kind = {1: FINEST, 2: FINE}.get(half, COARSE)
            if len(middle):
                yield self._first_pass(kind, middle, np.stack([middle - half, behind], axis=1), FULL_TRUST // 2)
            stride = half

    def _first_pass(self, kind: int, slot: Int[np.ndarray, " p"], beside: Int[np.ndarray, "p 2"], trust: int) -> Pass:
        rows = self.firsts[slot]
        nothing = np.zeros((len(slot), MATES_SEEN), np.int64)
        return Pass(
            kind, rows, self.firsts[beside], np.full(beside.shape, trust), nothing, nothing, slot, np.zeros_like(slot)
        )

    def _passes_of_mates(self) -> Iterator[Pass]:
        most = int(self.occupied_counts.max(initial=0))
        by_rank = np.argsort(self.ranks, kind="stable")
        ends = np.searchsorted(self.ranks[by_rank], np.arange(most + 1))
        low = 1
        while low < most:
            width = max(1, (1 << (low.bit_length() - 1)) // 2)
            rows = np.sort(by_rank[ends[low] : ends[min(low + width, most)]])
            slot = self.slots[rows]
            beside = np.stack([np.maximum(slot - 1, 0), np.minimum(slot + 1, len(self.firsts) - 1)], axis=1)
            seen = np.maximum(low - 1 - np.arange(MATES_SEEN), 0)
            near, trust = self.firsts[beside], np.full(beside.shape, FULL_TRUST // 2)
            mates = self.firsts[slot][:, None] + seen
            mate_trust = np.broadcast_to(even_trust(min(low, MATES_SEEN)), mates.shape)
            yield Pass(MATES, rows, near, trust, mates, mate_trust, slot, self.ranks[rows])
            low += width


def even_trust(n_mates: int) -> Int[np.ndarray, " j"]:
    """Split full trust among the first `n_mates` of the mates seen, the last of them getting what does not divide."""
    trust = np.zeros(MATES_SEEN, np.int64)
    trust[:n_mates] = FULL_TRUST // n_mates
    trust[0] += FULL_TRUST - trust.sum()
    return trust
