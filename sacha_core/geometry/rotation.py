"""Rotations written as axis-angle vectors."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["ANGLE_OFFSET_RAD", "SMALLEST_ANGLE_RAD", "rotation_vectors_to_matrices"]

# FLAME adds it to each component before it takes the angle, which keeps the axis finite at rest
ANGLE_OFFSET_RAD = 1e-8
SMALLEST_ANGLE_RAD = 1e-15  # only a vector that cancels the offset has less; dividing by this keeps its rotation finite


def rotation_vectors_to_matrices(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    r"""Give the matrix of each rotation vector by Rodrigues' formula, with the angle that FLAME uses.

    $R = I + \frac{\sin\varphi}{\varphi} K + \frac{1 - \cos\varphi}{\varphi^2} K^2$ with $K$ the cross-product matrix of the vector and
    $\varphi = |v + 10^{-8}|$. $1 - \cos$ is taken as $2 \sin^2(\varphi / 2)$, which does not cancel at small angles.

    Args:
        vectors: (..., 3) axis times angle, radians.

    Returns:
        (..., 3, 3) rotation matrices in the dtype of `vectors`.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017; the offset as the public FLAME layers have it.
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    shifted = vectors + vectors.dtype.type(ANGLE_OFFSET_RAD)
    angle = np.maximum(np.sqrt(np.einsum("...i,...i->...", shifted, shifted)), vectors.dtype.type(SMALLEST_ANGLE_RAD))
    first = np.sin(angle) / angle
    second = 2 * (np.sin(angle / 2) / angle) ** 2
    rows = [
        [1 - second * (y * y + z * z), second * x * y - first * z, second * x * z + first * y],
        [second * x * y + first * z, 1 - second * (x * x + z * z), second * y * z - first * x],
        [second * x * z - first * y, second * y * z + first * x, 1 - second * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
