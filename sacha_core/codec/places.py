"""Places that Gaussians sit at, and which of those already known lie nearest.

Places are numbered along a space-filling curve. Candidates for the nearest are the two known ones before and the two behind on the
curve, and the known ones among a place's neighbours on the mesh.

Source: own; the curve is Hilbert's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from sacha_core.codec.loops import compiled_loops

__all__ = ["FULL_TRUST", "NEAREST", "NOWHERE", "TRUST_BITS", "Places", "along_curve", "curve_index", "nearest_known"]

NOWHERE = -1
CURVE_BITS = 10
NEAREST = 4
TRUST_BITS = 6
FULL_TRUST = 1 << TRUST_BITS  # what the trust in a place's neighbours adds up to, where it has any
RATIO_BITS = 10
FAR = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Places:
    """Where Gaussians can sit, in coding order.

    Args:
        points: (m, 3) integers, in one unit.
        order: (m,) number of each place as the head counts them.
        beside: (m, b) neighbours on the mesh, `NOWHERE` where there are fewer.
    """

    points: Int[np.ndarray, "m 3"]
    order: Int[np.ndarray, " m"]
    beside: Int[np.ndarray, "m b"]

    def __len__(self) -> int:
        """Give the number of places."""
        return len(self.order)


def along_curve(
    points: Int[np.ndarray, "m 3"], cells: Int[np.ndarray, "m 3"], beside: Int[np.ndarray, "m b"]
) -> Places:
    """Put places in the order of the curve through their cells; `beside` counts as `points` do."""
    order = np.argsort(curve_index(cells), kind="stable")
    place = np.empty(len(order) + 1, np.int64)
    place[order] = np.arange(len(order))
    place[NOWHERE] = NOWHERE
    return Places(points[order], order, place[beside[order]])


def nearest_known(
    places: Places, known: Bool[np.ndarray, " m1"], asked: Int[np.ndarray, " p"]
) -> tuple[Int[np.ndarray, "p k"], Int[np.ndarray, "p k"]]:
    """Find the known places nearest to others.

    Args:
        places: all of them.
        known: (m + 1,) which of them are known; the last, which `NOWHERE` finds, is not.
        asked: (p,) whose neighbours are wanted; a place is no neighbour of its own.

    Returns:
        Places (any, where trust is 0) and trust, which falls with the square of the distance.
    """
    listed = np.flatnonzero(known)
    if len(listed) == 0:
        return np.zeros((len(asked), NEAREST), np.int64), np.zeros((len(asked), NEAREST), np.int64)
    low, high = (np.searchsorted(listed, asked, side=side) for side in ("left", "right"))
    compiled = compiled_loops("gathers", len(listed))
    if compiled:
        near, trust = np.zeros((len(asked), NEAREST), np.int64), np.zeros((len(asked), NEAREST), np.int64)
        compiled.nearest_places(
            places.points, places.beside, known, listed, low, high, asked, RATIO_BITS, TRUST_BITS, near, trust
        )
        return near, trust
    on_curve = np.stack([low - 2, low - 1, high, high + 1], axis=1)
    there = (on_curve >= 0) & (on_curve < len(listed))
    beside = places.beside[asked]
    candidates = np.concatenate([listed[np.where(there, on_curve, 0)], np.maximum(beside, 0)], axis=1)
    there = np.concatenate([there, known[beside] & (beside != asked[:, None])], axis=1)
    away = [places.points[:, axis][candidates] - places.points[:, axis][asked][:, None] for axis in range(3)]
    squared = np.where(there, away[0] * away[0] + away[1] * away[1] + away[2] * away[2], FAR)
    return pick_nearest(candidates, squared)


def pick_nearest(
    candidates: Int[np.ndarray, "p q"], squared: Int[np.ndarray, "p q"]
) -> tuple[Int[np.ndarray, "p k"], Int[np.ndarray, "p k"]]:
    """Take the nearest of each row, leaving out one that was taken just before, and share out trust."""
    order = np.argsort(squared, axis=1, kind="stable")
    squared, candidates = np.take_along_axis(squared, order, axis=1), np.take_along_axis(candidates, order, axis=1)
    squared[:, 1:][candidates[:, 1:] == candidates[:, :-1]] = FAR
    order = np.argsort(squared, axis=1, kind="stable")[:, :NEAREST]
    squared, near = np.take_along_axis(squared, order, axis=1), np.take_along_axis(candidates, order, axis=1)
    there = squared < FAR
    squared = np.where(there, squared, 0) + 1
    ratio = np.where(there, (squared[:, :1] << RATIO_BITS) // squared, 0)
    trust = (ratio << TRUST_BITS) // np.maximum(ratio.sum(axis=1, keepdims=True), 1)
    trust[:, 0] += np.where(there[:, 0], FULL_TRUST - trust.sum(axis=1), 0)
    return near, trust


def curve_index(cells: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " f"]:
    """Give the place of each cell on the Hilbert curve, on which consecutive cells touch.

    Source: Skilling, Programming the Hilbert curve, 2004: undo the reflections and exchanges of each level, then Gray-decode.
    """
    x = [cells[:, axis].astype(np.int64) for axis in range(3)]
    for bit in range(CURVE_BITS - 1, 0, -1):
        below = (1 << bit) - 1
        for axis in range(3):
            high = (x[axis] >> bit & 1) == 1
            swap = np.where(high, 0, (x[0] ^ x[axis]) & below)
            x[0] ^= np.where(high, below, swap)
            x[axis] ^= swap
    x[1] ^= x[0]
    x[2] ^= x[1]
    flip = np.zeros(len(cells), np.int64)
    for bit in range(CURVE_BITS - 1, 0, -1):
        flip ^= (x[2] >> bit & 1) * ((1 << bit) - 1)
    place = np.zeros(len(cells), np.int64)
    for bit in range(CURVE_BITS):
        for axis in range(3):
            place |= ((x[axis] ^ flip) >> bit & 1) << (3 * bit + 2 - axis)
    return place
