"""Points on a grid without loss, duplicates kept: how many of a box's points lie in its lower half, down to single cells.

Boxes are halved by x, y and z in turn, as an octree does in one step; the counts of all boxes of one size make a batch.

Source: own; a stand-in for the lossless octree of MPEG's G-PCC.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.paper_map import POSITION_BITS
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["BITS", "codes_of", "decode_points", "encode_points"]

AXES = 3
BITS = AXES * POSITION_BITS  # of a point
FEW = 8  # points of a box whose count is told as it is; more: as its difference to half
CLASSES = FEW + 24
DEPTHS_PER_CLASS = 6
N_CONTEXTS = CLASSES * (AXES * POSITION_BITS // DEPTHS_PER_CLASS)


def contexts_of(points: Int[np.ndarray, " b"], depth: int) -> Int[np.ndarray, " b"]:
    """Context of the count of each box: how many points it has, roughly, and how small it is."""
    many = FEW + np.minimum(np.frexp(points.astype(np.float64))[1].astype(np.int64), CLASSES - FEW - 1)
    return np.where(points <= FEW, points - 1, many) + CLASSES * (depth // DEPTHS_PER_CLASS)


def expected_of(points: Int[np.ndarray, " b"]) -> Int[np.ndarray, " b"]:
    """What counts are told the difference to."""
    return np.where(points <= FEW, 0, points >> 1)


def codes_of(points: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Give the bits of x, y and z of each point in turn, the highest first: boxes are runs of these in their order."""
    code = np.zeros(len(points), np.int64)
    for depth in range(BITS):
        code = code << 1 | (points[:, depth % AXES] >> (POSITION_BITS - 1 - depth // AXES) & 1)
    return code


def encode_points(points: Int[np.ndarray, "n 3"]) -> bytes:
    """Code points; their order is not kept.

    Args:
        points: (n, 3) grid coordinates, 0 to 2**18 - 1.
    """
    code = np.sort(codes_of(points))
    writer = SymbolWriter(N_CONTEXTS)
    for depth in range(AXES * POSITION_BITS if len(points) else 0):
        rest = AXES * POSITION_BITS - depth
        _, start, size = np.unique(code >> rest, return_index=True, return_counts=True)
        upper = np.add.reduceat(code >> (rest - 1) & 1, start)
        writer.write(size - upper - expected_of(size), contexts_of(size, depth))
    return writer.finish()


def decode_points(reader: ByteReader, n: int) -> Int[np.ndarray, "n 3"]:
    """Read n points, sorted by x, then y, then z.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    symbols = SymbolReader(reader, N_CONTEXTS)
    box, size = np.zeros((min(n, 1), AXES), np.int64), np.full(min(n, 1), n)
    for depth in range(AXES * POSITION_BITS if n else 0):
        lower = symbols.read(contexts_of(size, depth)) + expected_of(size)
        if lower.min() < 0 or (lower > size).any():
            raise reader.error("a half of a box has more points than the box")
        axis = depth % AXES
        box[:, axis] <<= 1
        halves = np.repeat(box, 2, axis=0)
        halves[1::2, axis] += 1
        sizes = np.stack([lower, size - lower], axis=1).reshape(-1)
        box, size = halves[sizes > 0], sizes[sizes > 0]
    symbols.check_end()
    points = np.repeat(box, size, axis=0)
    return points[np.lexsort(points.T[::-1])]
