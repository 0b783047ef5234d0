"""A camera as the kernels want it."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from sacha_core.errors import OptionError
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels import layout

__all__ = ["MAX_SIDE", "tile_grid", "view_parameters"]

MAX_SIDE = 16384
SLACK = 0.15  # of the image's side: how far outside it the Jacobian still follows the mean


def view_parameters(camera: Camera, near: float) -> Float[np.ndarray, " k"]:
    """Give the camera's parameters in the kernels' order, float32.

    Raises:
        OptionError: a side is not 1 to 16384 pixels, a number is not finite, or rotation or translation have another shape.

    Source: limits of the slopes as gsplat has them.
    """
    if not (1 <= camera.width <= MAX_SIDE and 1 <= camera.height <= MAX_SIDE):
        raise OptionError(f"the image is {camera.width} x {camera.height} pixels, expected 1 to {MAX_SIDE} a side")
    if not (0 < camera.fx < math.inf and 0 < camera.fy < math.inf):
        raise OptionError(f"the focal lengths are {camera.fx} and {camera.fy}, expected finite numbers above 0")
    shapes = np.shape(camera.rotation), np.shape(camera.translation)
    if shapes != ((3, 3), (3,)):
        raise OptionError(f"the camera's rotation and translation have shapes {shapes}, expected (3, 3) and (3,)")
    view = np.zeros(layout.VIEW)
    view[layout.V_ROTATION : layout.V_ROTATION + 9] = np.ravel(camera.rotation)
    view[layout.V_TRANSLATION : layout.V_TRANSLATION + 3] = camera.translation
    left, right, top, bottom = camera.edges
    slack_x, slack_y = SLACK * (right - left), SLACK * (bottom - top)
    numbers = {
        layout.V_FX: camera.fx, layout.V_FY: camera.fy, layout.V_CX: camera.cx, layout.V_CY: camera.cy,
        layout.V_X_MIN: left - slack_x, layout.V_X_MAX: right + slack_x, layout.V_Y_MIN: top - slack_y, layout.V_Y_MAX: bottom + slack_y,
        layout.V_NEAR: near, layout.V_WIDTH: camera.width, layout.V_HEIGHT: camera.height,
    }  # fmt: skip
    for place, number in numbers.items():  # one by one is ten times as fast as by a list of places
        view[place] = number
    if not np.isfinite(view).all():
        raise OptionError("the camera's principal point, rotation or translation is not finite")
    return view.astype(np.float32)


def tile_grid(camera: Camera) -> tuple[int, int]:
    """Give the number of columns and rows of tiles."""
    return -(-camera.width // layout.TILE_WIDTH), -(-camera.height // layout.TILE_HEIGHT)
