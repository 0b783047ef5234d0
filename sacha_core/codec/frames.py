r"""Frames of the triangles of the unposed head, in cells of the template's grid: how attributes change from triangle to world axes.

Integers, and float64 operations of which each is rounded alone, in the order written, so that every machine has the same bits. A triangle
that has no area on the grid has the axes of the world and a scale of one cell.

Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["RestFrames", "frames_of", "quaternions_of"]


@dataclass(frozen=True)
class RestFrames:
    """Frames of p triangles.

    Args:
        axes: (3, 3, p) columns of each rotation: `axes[i, j]` is the world's component i of axis j.
        scale: (p,) grid cells.
        sums: (p, 3) of the three corners, grid cells.
    """

    axes: Float[np.ndarray, "3 3 p"]
    scale: Float[np.ndarray, " p"]
    sums: Int[np.ndarray, "p 3"]


def frames_of(corners: Int[np.ndarray, "p 3 3"]) -> RestFrames:
    """Give the frames of triangles from their corners on the grid."""
    edge, second = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    normal = cross(edge, second)  # exact: 2^42 at most
    x, y, z = edge.astype(np.float64)
    length = np.sqrt((x * x + y * y) + z * z)
    u, v, w = normal.astype(np.float64)
    area = np.sqrt((u * u + v * v) + w * w)
    flat = area == 0
    safe_length, safe_area = np.where(flat, 1.0, length), np.where(flat, 1.0, area)
    first, middle = np.stack([x, y, z]) / safe_length, np.stack([u, v, w]) / safe_area
    axes = np.stack([first, middle, cross(first, middle)], axis=1)
    axes[:, :, flat] = np.eye(3)[:, :, None]
    scale = np.where(flat, 1.0, (safe_length + safe_area / safe_length) * 0.5)
    return RestFrames(axes, scale, corners.sum(axis=1))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of (3, p) and (3, p), products first, then the difference."""
    return np.stack([a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))])


def quaternions_of(axes: Float[np.ndarray, "3 3 p"]) -> Float[np.ndarray, "4 p"]:
    """Give the unit quaternion (wxyz) of each rotation, by its largest component (the first of equals)."""
    m = axes
    squares = np.stack(
        [
            ((1 + m[0, 0]) + m[1, 1]) + m[2, 2],
            ((1 + m[0, 0]) - m[1, 1]) - m[2, 2],
            ((1 - m[0, 0]) + m[1, 1]) - m[2, 2],
            ((1 - m[0, 0]) - m[1, 1]) + m[2, 2],
        ]
    )
    largest = np.argmax(squares, axis=0)
    double = np.sqrt(squares.max(axis=0))  # twice the largest component
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    own = double * double
    rows = np.stack(
        [np.stack([own, a, b, c]), np.stack([a, own, d, e]), np.stack([b, d, own, f]), np.stack([c, e, f, own])]
    )
    chosen = np.take_along_axis(rows, largest[None, None], axis=0)[0]
    return np.asarray(chosen / (2 * double))
