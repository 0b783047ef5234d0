"""The part of an image that Gaussians reach."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.parallel.pool import Pool, even_ranges
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.bounds import reach
from sacha_core.raster.rasteriser import NEAR
from sacha_core.raster.view import view_parameters

__all__ = ["image_bounds", "pixel_box"]

Sides = tuple[float, float, float, float]


def image_bounds(
    means: Float[np.ndarray, "n 3"],
    scales: Float[np.ndarray, "n 3"],
    opacities: Float[np.ndarray, " n"],
    camera: Camera,
    near: float = NEAR,
    margin: int = 0,
    pool: Pool | None = None,
) -> tuple[int, int, int, int] | None:
    """Give a rectangle of the image outside which nothing is drawn, to be given to `Camera.crop`.

    It is generous to long Gaussians seen from their end: each is taken for a ball.

    Args:
        means: (n, 3) metres, contiguous float32, as are the next two.
        scales: (n, 3) metres.
        opacities: (n,) 0 to 1.
        camera: the image's.
        near: what is closer to the camera's plane is not drawn, metres.
        margin: pixels to add on each side, as far as the image reaches.
        pool: shares out the work; None for the calling thread alone.

    Returns:
        left, top, width, height in pixels; None where nothing is drawn.

    Raises:
        OptionError: the camera is unusable.
    """
    view = view_parameters(camera, near)
    bounds = even_ranges(len(means), pool.threads if pool else 1)
    sides: dict[int, Sides] = {}

    def job(_: int, k: int) -> None:
        sides[k] = reach(bounds[k], bounds[k + 1], means, scales, opacities, view)

    (pool or Pool(1)).run(job, len(bounds) - 1)
    return pixel_box(sides.values(), camera, margin)


def pixel_box(sides: Iterable[Sequence[float]], camera: Camera, margin: int = 0) -> tuple[int, int, int, int] | None:
    """Give the rectangle of the pixels whose centres lie between any of the sides that `reach` gives; else as `image_bounds`."""
    lefts, tops, rights, bottoms = zip((math.inf, math.inf, -math.inf, -math.inf), *sides, strict=True)
    across = pixel_range(min(lefts), max(rights), camera.width, margin)
    down = pixel_range(min(tops), max(bottoms), camera.height, margin)
    if across is None or down is None:
        return None
    return across[0], down[0], across[1], down[1]


def pixel_range(low: float, high: float, pixels: int, margin: int) -> tuple[int, int] | None:
    """Give the first and the number of the pixels whose centres lie between two sides, and of a margin around them; None if none does."""
    if not low <= high:
        return None
    first, last = max(math.ceil(low - 0.5), 0), min(math.floor(high - 0.5), pixels - 1)
    if first > last:
        return None
    first, last = max(first - margin, 0), min(last + margin, pixels - 1)
    return first, last - first + 1
