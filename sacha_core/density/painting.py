"""Importance that somebody painted on the head, as factors of its triangles.

Source: own.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sacha_core.errors import FormatError, TopologyError
from sacha_core.flame.model import HeadModel

__all__ = ["painted_importance", "read_painting"]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear light, ITU-R BT.709
SLACK = 1e-6  # that painted values may exceed 1 by, as floats do


def read_painting(path: str | os.PathLike[str]) -> Float[np.ndarray, "..."]:
    """Read an array of a `.npy` file.

    Raises:
        FormatError: it holds something else than numbers that are finite and not negative.
        OSError: it cannot be read.
    """
    with Path(path).open("rb") as file:
        if file.read(6) != b"\x93NUMPY":
            raise FormatError(f"{path}: not a .npy file of one array", offset=0)
    try:
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except (ValueError, EOFError) as error:
        raise FormatError(f"{path}: damaged .npy file: {error}") from error
    if array.dtype.kind not in "fiu" or not (np.isfinite(array) & (array >= 0)).all():
        raise FormatError(f"{path}: {array.dtype} that are not all finite and from 0; expected such numbers")
    return np.asarray(array, np.float64)


def painted_importance(
    painting: Float[np.ndarray, "..."], head: HeadModel, strength: float | None = None
) -> Float[np.ndarray, " f"]:
    """Turn what was painted into the factor of each triangle, the mean over its corners.

    Args:
        painting: (f,) of triangles, (v,) of vertices or (3 f,) of their corners, in order; or linear colours of these, (..., 3) or
            (..., 4), of which the luminance counts.
        head: on which.
        strength: factor of what is painted 1; what is painted 0 has the factor 1, and between them it grows geometrically. None where the
            painted numbers are the factors.

    Raises:
        TopologyError: there are not as many numbers as the head has triangles, vertices or corners, or one cannot tell which.
        FormatError: with a strength, a number is above 1.
    """
    if painting.ndim == 2 and painting.shape[1] in {3, 4}:
        painting = painting[:, :3] @ LUMINANCE
    n_faces, n_vertices, n = head.n_faces, head.n_vertices, painting.shape[0] if painting.ndim == 1 else -1
    if n not in {n_faces, n_vertices, 3 * n_faces}:
        raise TopologyError(
            f"painted are {painting.shape} numbers, but head {head.name!r} has {n_faces} triangles, {n_vertices} vertices and"
            f" {3 * n_faces} corners"
        )
    if n == n_faces == n_vertices:
        raise TopologyError(
            f"head {head.name!r} has {n_faces} triangles and as many vertices; expected a number for each corner"
        )
    if n == n_vertices:
        painting = painting[head.faces].mean(axis=1)
    elif n == 3 * n_faces:
        painting = painting.reshape(n_faces, 3).mean(axis=1)
    if strength is None:
        return painting
    if painting.max(initial=0) > 1 + SLACK:
        raise FormatError(
            f"painted is up to {painting.max():g}, expected 0 to 1 where a strength says what 1 stands for"
        )
    factors: np.ndarray = strength**painting
    return factors
