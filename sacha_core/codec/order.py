"""The order in which Gaussians are coded, and what each is predicted from; both sides derive it before any attribute is known.

The *first* Gaussian of each occupied place is coded coarse to fine: every 2^L-th place along the curve, then the ones half way between,
each predicted from the nearest already known. Where places are triangles, the further Gaussians of a triangle, its *mates*, follow rank
by rank (ranks 1, 2, 3, 4-5, 6-7, 8-11, ... make one pass each), predicted from the ones before in the triangle as well. Where places are
the vertices of the once-subdivided mesh, each carries one Gaussian, and the middles of edges follow the head's own vertices. So a pass is
a handful of array operations, and their number grows with the logarithm of the counts.

Source: own; coarse to fine as in lifting schemes (Sweldens, 1996).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from sacha_core.codec.anchors import middle_of, triangle_of
from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.places import FULL_TRUST, TRUST_BITS, Places, nearest_known
from sacha_core.codec.template import Template

__all__ = [
    "FULL_TRUST",
    "KINDS",
    "MATES",
    "Layout",
    "Pass",
    "layout_by_triangle",
    "layout_by_vertex",
    "passes_over",
    "trusted",
    "weighted_mean",
]

COARSE, FINE, FINEST, MATES = 0, 1, 2, 3
KINDS = 4
MATES_SEEN = 8


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
        slot: (p,) occupied place of each, counted from 0.
        rank: (p,) rank of each at its place.
    """

    kind: int
    rows: Int[np.ndarray, " p"]
    near: Int[np.ndarray, "p k"]
    trust: Int[np.ndarray, "p k"]
    mates: Int[np.ndarray, "p j"]
    mate_trust: Int[np.ndarray, "p j"]
    slot: Int[np.ndarray, " p"]
    rank: Int[np.ndarray, " p"]


@dataclass(frozen=True)
class Layout:
    """Where the n Gaussians lie, sorted by place in coding order.

    Args:
        template: what is known of the head.
        binding: (n,) triangle of each Gaussian, as the head counts them.
        triangle_size: (n,) size class of that triangle, eighths of an octave.
        firsts: (m,) row of the first Gaussian at each occupied place.
        slots: (n,) occupied place of each Gaussian, counted from 0.
        ranks: (n,) rank of each Gaussian at its place.
        passes: in coding order; together they hold every Gaussian once.
        anchors: (n, 3) the vertex that each Gaussian belongs to, in half grid cells; None where places are triangles.
    """

    template: Template
    binding: Int[np.ndarray, " n"]
    triangle_size: Int[np.ndarray, " n"]
    firsts: Int[np.ndarray, " m"]
    slots: Int[np.ndarray, " n"]
    ranks: Int[np.ndarray, " n"]
    passes: tuple[Pass, ...]
    anchors: Int[np.ndarray, "n 3"] | None = None

    def __len__(self) -> int:
        """Give the number of Gaussians."""
        return len(self.binding)


def trusted(trust: Int[np.ndarray, "p k"]) -> bool:
    """Tell whether the Gaussians of a pass have any such neighbours: all have, or none."""
    return bool(trust.size) and bool(trust[0].any())


def weighted_mean(
    values: Int[np.ndarray, "n ..."], rows: Int[np.ndarray, "p k"], trust: Int[np.ndarray, "p k"]
) -> Int[np.ndarray, "p ..."]:
    """Mean of the values at `rows` by trust, halves up; 0 where there is no trust."""
    shown = trusted(trust)
    compiled = compiled_loops("gathers", len(values)) if shown else None
    if compiled and values.dtype == np.int64:
        mean = np.empty((len(rows), *values.shape[1:]), np.int64)
        flat = values.reshape(len(values), -1)
        compiled.mean_rows(flat, rows, np.ascontiguousarray(trust), TRUST_BITS, mean.reshape(len(rows), -1))
        return mean
    shape = (len(rows),) + (1,) * (values.ndim - 1)
    total = np.full((len(rows), *values.shape[1:]), FULL_TRUST // 2, np.int64)
    if shown:
        for column in range(rows.shape[1]):  # column by column is faster than an axis of four
            total += values.take(rows[:, column], axis=0) * trust[:, column].reshape(shape)
    total >>= TRUST_BITS
    return total


def layout_by_triangle(counts: Int[np.ndarray, " f"], template: Template) -> Layout:
    """Lay out Gaussians of which triangles carry so many (in coding order)."""
    occupied = np.flatnonzero(counts)
    held = counts[occupied].astype(np.int64)
    firsts = np.cumsum(held) - held
    slots = np.repeat(np.arange(len(occupied)), held)
    ranks = np.arange(len(slots)) - firsts[slots]
    places = template.triangles
    passes = (
        *passes_of_firsts(places, occupied, firsts, halves(len(occupied))),
        *passes_of_mates(places, occupied, firsts, ranks, slots),
    )
    place = occupied[slots]
    binding = places.order[place].astype(np.int32)
    return Layout(template, binding, template.size[place], firsts, slots, ranks, passes)


def layout_by_vertex(present: Bool[np.ndarray, " m"], template: Template) -> Layout:
    """Lay out Gaussians of which each belongs to one of the vertices that are present (in coding order)."""
    places = template.vertices
    occupied = np.flatnonzero(present)
    rows = np.arange(len(occupied))
    passes = tuple(passes_of_firsts(places, occupied, rows, own_then_middles(middle_of(template)[occupied])))
    binding = triangle_of(template)[occupied]
    size = template.size[np.argsort(template.order)[binding]]
    nobody = np.zeros_like(rows)
    return Layout(template, binding.astype(np.int32), size, rows, rows, nobody, passes, places.points[occupied])


def passes_over(template: Template, by_vertex: bool) -> Iterator[Pass]:
    """Give the passes over all places, as if each had one Gaussian."""
    places = template.vertices if by_vertex else template.triangles
    everyone = np.arange(len(places))
    groups = own_then_middles(middle_of(template)) if by_vertex else halves(len(places))
    return passes_of_firsts(places, everyone, everyone, groups)


Groups = Iterator[tuple[int, Int[np.ndarray, " p"]]]


def own_then_middles(middle: Bool[np.ndarray, " m"]) -> Groups:
    """Give kind and slots of each pass over vertices: the head's own coarse to fine, then every other middle, then the rest."""
    own, middles = np.flatnonzero(~middle), np.flatnonzero(middle)
    for kind, slot in halves(len(own)):
        yield FINE if kind == FINEST else COARSE, own[slot]
    yield FINEST, middles[::2]
    yield FINEST, middles[1::2]


def halves(m: int) -> Groups:
    """Give the kind and the slots of each pass over m slots, coarse to fine."""
    if m:
        yield COARSE, np.zeros(1, np.int64)
    stride = 1 << max(m - 1, 0).bit_length()
    while stride > 1:
        half = stride // 2
        yield {1: FINEST, 2: FINE}.get(half, COARSE), np.arange(half, m, stride)
        stride = half


def passes_of_firsts(
    places: Places,
    occupied: Int[np.ndarray, " m"],
    firsts: Int[np.ndarray, " m"],
    groups: Groups,
) -> Iterator[Pass]:
    """Give a pass for each group of slots that is not empty."""
    known = np.zeros(len(places) + 1, bool)  # with one more for nowhere
    row_of = np.zeros(len(places), np.int64)
    row_of[occupied] = firsts
    for kind, slot in groups:
        if len(slot):
            near, trust = nearest_known(places, known, occupied[slot])
            nothing = np.zeros((len(slot), 0), np.int64)
            yield Pass(kind, firsts[slot], row_of[near], trust, nothing, nothing, slot, np.zeros_like(slot))
            known[occupied[slot]] = True


def passes_of_mates(
    places: Places,
    occupied: Int[np.ndarray, " m"],
    firsts: Int[np.ndarray, " m"],
    ranks: Int[np.ndarray, " n"],
    slots: Int[np.ndarray, " n"],
) -> Iterator[Pass]:
    """Give the passes over all but the firsts."""
    most = int(ranks.max(initial=0)) + 1
    by_rank = np.argsort(ranks, kind="stable")
    ends = np.searchsorted(ranks[by_rank], np.arange(most + 1))
    crowded = slots[by_rank[ends[1] : ends[min(2, most)]]]  # slots of more than one, ascending
    near, trust = firsts_nearby(places, occupied, firsts, crowded)
    low = 1
    while low < most:
        width = max(1, (1 << (low.bit_length() - 1)) // 2)
        rows = np.sort(by_rank[ends[low] : ends[min(low + width, most)]])
        slot = slots[rows]
        at = np.searchsorted(crowded, slot)
        share = even_trust(min(low, MATES_SEEN))
        mates = firsts[slot][:, None] + low - 1 - np.arange(len(share))
        mate_trust = np.broadcast_to(share, mates.shape)
        yield Pass(MATES, rows, near[at], trust[at], mates, mate_trust, slot, ranks[rows])
        low += width


def firsts_nearby(
    places: Places, occupied: Int[np.ndarray, " m"], firsts: Int[np.ndarray, " m"], slot: Int[np.ndarray, " p"]
) -> tuple[Int[np.ndarray, "p k"], Int[np.ndarray, "p k"]]:
    """Give the rows of the firsts nearest to slots, but for their own, and the trust in them."""
    known = np.zeros(len(places) + 1, bool)
    known[occupied] = True
    near, trust = nearest_known(places, known, occupied[slot])
    row_of = np.zeros(len(places), np.int64)
    row_of[occupied] = firsts
    return row_of[near], trust


def even_trust(n_mates: int) -> Int[np.ndarray, " j"]:
    """Split full trust among mates, the first of them getting what does not divide."""
    trust = np.full(n_mates, FULL_TRUST // n_mates)
    trust[0] += FULL_TRUST - trust.sum()
    return trust
