"""How far the outline of the posed head agrees with the mask of a view, on a coarse grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.raster.camera import Camera

__all__ = ["CoarseMask", "agreement", "coarse_mask", "surface_points"]

CELLS_HIGH = 48  # of the grid: a head is some twenty cells across
ENOUGH_POINTS = 10_000  # on a head, so that several fall into each cell that it covers


@dataclass(frozen=True)
class CoarseMask:
    """Where a view shows the person, on a grid of square cells.

    Args:
        covered: (rows, columns) whether most of a cell is masked.
        cell: pixels along the side of a cell.
    """

    covered: Bool[np.ndarray, "rows columns"]
    cell: int


def coarse_mask(mask: Bool[np.ndarray, "h w"]) -> CoarseMask:
    """Shrink a mask; what does not fill a cell at the right and lower edge is left out."""
    cell = max(mask.shape[0] // CELLS_HIGH, 1)
    rows, columns = (side // cell for side in mask.shape)
    blocks = mask[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell)
    return CoarseMask(blocks.mean(axis=(1, 3)) > 0.5, cell)


def surface_points(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "p 3"]:
    """Give points all over a mesh: its triangles' corners, and where these are few, evenly spaced ones within each."""
    order = max(int(np.ceil(np.sqrt(2 * ENOUGH_POINTS / len(faces)))), 1)
    steps = [(i, j, order - i - j) for i in range(order + 1) for j in range(order + 1 - i)]
    points: np.ndarray = np.einsum("pc,fcx->fpx", np.array(steps) / order, vertices[faces]).reshape(-1, 3)
    return points if order > 1 else vertices


def agreement(points: Float[np.ndarray, "p 3"], camera: Camera, mask: CoarseMask) -> float:
    """Give the area that head and mask share over the area that either has: 1 where they are the same, 0 where they are apart.

    Hair and shoulders belong to the mask alone, so that good tracks give 0.5 to 0.9. What of the head falls beside the image counts
    against it.

    Args:
        points: (p, 3) all over the posed head, metres.
        camera: of the view, at the mask's resolution.
        mask: of the view.
    """
    places = camera.project(points)
    pixels = places[~np.isnan(places[:, 0])]
    if not len(pixels):
        return 0.0
    far = 4 * max(mask.covered.shape)  # cells beside the image are counted, but not without end
    cells = np.clip(np.floor(pixels / mask.cell), -far, far).astype(np.int64)
    column, row = np.unique(cells, axis=0).T
    rows, columns = mask.covered.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    shared = int(mask.covered[row[inside], column[inside]].sum())
    return shared / (len(row) + int(mask.covered.sum()) - shared)
