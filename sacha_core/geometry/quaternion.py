"""Quaternions, w first, in batches; every function keeps the dtype that it is given."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["from_matrix", "multiply", "normalise", "to_matrix"]

SMALLEST_NORM = 1e-12  # below it a quaternion has no direction; dividing by this keeps the result finite


def normalise(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 4"]:
    """Give quaternions of unit length and the same direction; one of length zero stays zero, one that is not finite is none after it."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.einsum("...i,...i->...", q, q))
        unit: np.ndarray = q / np.maximum(length, q.dtype.type(SMALLEST_NORM))[..., None]
    return unit


def multiply(a: Float[np.ndarray, "*a 4"], b: Float[np.ndarray, "*b 4"]) -> Float[np.ndarray, "*c 4"]:
    """Give the Hamilton product: the rotation `b` followed by the rotation `a`. Batches broadcast."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def from_matrix(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    r"""Give the unit quaternion of each rotation matrix, its component of largest magnitude positive.

    $4 q q^T$ is linear in the matrix; its row with the largest diagonal entry is $q$ up to a length that is never small.

    Args:
        rotation: (..., 3, 3) proper rotations.

    Returns:
        (..., 4) wxyz.

    Source: Shepperd, Quaternion from rotation matrix, 1978.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(rotation, (-2, -1), (0, 1))
    diagonal = np.stack([xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy]) + rotation.dtype.type(1)
    wx, wy, wz = zy - yz, xz - zx, yx - xy
    sxy, sxz, syz = xy + yx, xz + zx, yz + zy
    largest = np.argmax(diagonal, axis=0)
    w, x, y, z = diagonal
    rows = ((w, wx, wy, wz), (wx, x, sxy, sxz), (wy, sxy, y, syz), (wz, sxz, syz, z))
    return normalise(np.stack([np.choose(largest, row) for row in rows], axis=-1))


def to_matrix(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Give the rotation matrix of each quaternion, which need not be of unit length."""
    w, x, y, z = np.moveaxis(normalise(q), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
