"""Laying Gaussians out as an image in which neighbours on the head are neighbours, so that a video codec finds something to predict.

The head is unrolled around its vertical axis, and its Gaussians are dealt to the cells of a square by halving both in turn. All of it
follows from the triangles of the Gaussians and the head at rest, which a decoder has, so the layout costs no bytes but counts a triangle.

Source: own; images of sorted attributes are the route of Morgenstern et al., Self-Organizing Gaussian Grids, ECCV 2024.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.evaluate.peers.peer import Ground

__all__ = ["SIDE_OF_BLOCK", "dealt", "from_image", "grid_of", "side_for", "to_image", "unrolled"]

SIDE_OF_BLOCK = 8  # sides of pictures are multiples of it, as HEVC has it
SMALLEST = 64  # side; libx265 takes no pictures that are much smaller


def grid_of(binding: Int[np.ndarray, " n"], ground: Ground) -> tuple[Int[np.ndarray, " n"], int]:
    """Give the cell of each Gaussian in a square, and the square's side.

    Args:
        binding: (n,) triangles, in the order that the decoder has them in.
        ground: the head.

    Returns:
        Cells, row times side plus column, and the side, a multiple of `SIDE_OF_BLOCK`.
    """
    side = side_for(len(binding))
    return dealt(unrolled(ground.centroids)[binding], side), side


def side_for(n: int) -> int:
    """Give the side of a square that has a cell for each of n Gaussians."""
    return max(-(-int(np.ceil(np.sqrt(n))) // SIDE_OF_BLOCK) * SIDE_OF_BLOCK, SMALLEST)


def dealt(flat: Float[np.ndarray, "n 2"], side: int) -> Int[np.ndarray, " n"]:
    """Give each place of a plane a cell of its own in a square of at least as many, so that neighbours stay neighbours."""
    coordinates = np.full((side * side, 2), np.inf)
    coordinates[: len(flat)] = flat
    cells = np.empty(side * side, np.int64)
    deal(np.arange(side * side), coordinates, cells, (0, 0, side, side), side)
    return cells[: len(flat)]


def unrolled(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Give the places of points on the unrolled cylinder around their middle: height, and length around it; metres."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    away = points - middle
    radius = float(np.median(np.hypot(away[:, 0], away[:, 2])))
    return np.stack([-away[:, 1], radius * np.arctan2(away[:, 0], away[:, 2])], 1)


def deal(
    rows: Int[np.ndarray, " m"],
    coordinates: Float[np.ndarray, "n 2"],
    cells: Int[np.ndarray, " n"],
    box: tuple[int, int, int, int],
    side: int,
) -> None:
    """Deal as many Gaussians as a rectangle has cells to its cells: half of them to each half of it, along its longer side."""
    top, left, height, width = box
    along = 0 if height >= width else 1
    order = rows[np.argsort(coordinates[rows, along], kind="stable")]
    if min(height, width) == 1:
        steps = np.arange(max(height, width))
        cells[order] = (top + steps * (along == 0)) * side + left + steps * (along == 1)
        return
    half = (height if along == 0 else width) // 2
    if along == 0:
        first, second = (top, left, half, width), (top + half, left, height - half, width)
    else:
        first, second = (top, left, height, half), (top, left + half, height, width - half)
    count = first[2] * first[3]
    deal(order[:count], coordinates, cells, first, side)
    deal(order[count:], coordinates, cells, second, side)


def to_image(values: Int[np.ndarray, "n c"], cells: Int[np.ndarray, " n"], side: int) -> Int[np.ndarray, "c side side"]:
    """Put the columns of Gaussians into planes; empty cells take the value before them."""
    filled = np.zeros(side * side, bool)
    filled[cells] = True
    nearest = np.maximum.accumulate(np.where(filled, np.arange(side * side), 0))
    planes = np.zeros((side * side, values.shape[1]), values.dtype)
    planes[cells] = values
    return planes[nearest].T.reshape(-1, side, side)


def from_image(planes: Int[np.ndarray, "c side side"], cells: Int[np.ndarray, " n"]) -> Int[np.ndarray, "n c"]:
    """Undo `to_image`."""
    return np.asarray(planes.reshape(len(planes), -1).T[cells])
