"""Spherical harmonics in other axes: coefficients that give the same colours when everything is turned."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.raster.kernels.harmonics import BASIS

__all__ = ["turned_harmonics"]

DIRECTIONS = 64  # more than the 15 unknowns of degree 3, and spread evenly: the equations are as good as orthogonal


def turned_harmonics(
    sh_rest: Float[np.ndarray, "n k 3"], rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "n k 3"]:
    r"""Turn coefficients of degree 1 to 3: $f'(R d) = f(d)$ for every direction d.

    Args:
        sh_rest: (n, k, 3) with k 0, 3, 8 or 15.
        rotation: (3, 3) proper.

    Returns:
        (n, k, 3) in the dtype of `sh_rest`; a degree never mixes with another.

    Source: own; a rotation maps the functions of a degree onto one another, so that as many directions as unknowns tell the map.
    """
    k = sh_rest.shape[1]
    turned = np.empty_like(sh_rest)
    directions = _spread(DIRECTIONS)
    before, after = _basis(directions @ rotation), _basis(directions)  # rows are R^-1 d and d
    for first, stop in ((0, 3), (3, 8), (8, 15)):
        if stop > k:
            break
        matrix = np.linalg.lstsq(after[:, first:stop], before[:, first:stop], rcond=None)[0]
        turned[:, first:stop] = np.einsum("ab,nbc->nac", matrix, sh_rest[:, first:stop], optimize=True)
    return turned


def _spread(n: int) -> Float[np.ndarray, "n 3"]:
    """Give unit vectors in all directions, along a spiral of golden angles."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def _basis(directions: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 15"]:
    """Give the basis functions of degree 1 to 3 at unit vectors, in the order and with the signs of 3D Gaussian Splatting."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    values = (
        y, z, x,
        x * y, y * z, 2 * zz - xx - yy, x * z, xx - yy,
        y * (3 * xx - yy), x * y * z, y * (4 * zz - xx - yy), z * (2 * zz - 3 * xx - 3 * yy), x * (4 * zz - xx - yy),
        z * (xx - yy), x * (xx - 3 * yy),
    )  # fmt: skip
    basis: np.ndarray = np.stack(values, axis=1) * np.array(BASIS[1:])
    return basis
