"""Textures of what is known of triangles: each texel shows the triangle that it lies in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from sacha_core.errors import OptionError
from sacha_core.raster.kernels.texture import cover, spread
from sacha_core.raster.view import MAX_SIDE

__all__ = ["paint_triangles", "triangle_map"]

FARTHEST = 1e6  # texture coordinates beyond are nobody's


def triangle_map(uv: Float[np.ndarray, "f 3 2"], size: int, margin: int = 8) -> Int[np.ndarray, "h w"]:
    """Say which triangle each texel of a square texture shows.

    Args:
        uv: (f, 3, 2) texture coordinates at the corners, (0, 0) at the lower left and (1, 1) at the upper right corner; what lies
            outside is left out, and where triangles lie on each other the first one shows.
        size: texels of a side.
        margin: how many texels charts grow by at their borders, so that nothing of the background bleeds in when a texture is sampled.

    Returns:
        (size, size) int32 triangle, -1 for none; row 0 is the top.

    Raises:
        OptionError: the size is out of range, or a coordinate is not finite.
    """
    if not 1 <= size <= MAX_SIDE:
        raise OptionError(f"a texture of {size} texels a side was asked for, expected 1 to {MAX_SIDE}")
    if not (np.abs(uv) < FARTHEST).all():  # false for NaN, too
        raise OptionError("a texture coordinate is not finite or far outside the texture")
    texels = uv.astype(np.float64) * (1, -1) + (0, 1)
    labels = np.full((size, size), -1, np.int32)
    cover(np.ascontiguousarray(texels * size), labels)
    for _ in range(margin):
        grown = np.empty_like(labels)
        spread(labels, grown)
        labels = grown
    return labels


def paint_triangles(
    uv: Float[np.ndarray, "f 3 2"], colours: UInt8[np.ndarray, "f 3"], size: int, margin: int = 8
) -> UInt8[np.ndarray, "h w 4"]:
    """Paint a texture in which each triangle has its colour; between charts it is transparent.

    Args:
        uv: as of `triangle_map`, as are size and margin.
        colours: (f, 3) sRGB.
        size: texels of a side.
        margin: texels.

    Raises:
        OptionError: as `triangle_map`, or there is not one colour for each triangle.
    """
    if len(colours) != len(uv):
        raise OptionError(f"there are {len(colours)} colours for {len(uv)} triangles")
    labels = triangle_map(uv, size, margin)
    painted = np.zeros((size, size, 4), np.uint8)
    shown = labels >= 0
    painted[shown, :3] = colours[labels[shown]]
    painted[shown, 3] = 255
    return painted
