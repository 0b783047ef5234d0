"""A camera as the kernels want it."""

from __future__ import annotations

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
    if not (np.isfinite([camera.fx, camera.fy]).all() and camera.fx > 0 and camera.fy > 0):
        raise OptionError(f"the focal lengths are {camera.fx} and {camera.fy}, expected finite numbers above 0")
    shapes = np.shape(camera.rotation), np.shape(camera.translation)
    if shapes != ((3, 3), (3,)):
        raise OptionError(f"the camera's rotation and translation have shapes {shapes}, expected (3, 3) and (3,)")
    view = np.zeros(layout.VIEW)
    view[layout.V_ROTATION : layout.V_ROTATION + 9] = np.ravel(camera.rotation)
    view[layout.V_TRANSLATION : layout.V_TRANSLATION + 3] = camera.translation
    view[[layout.V_FX, layout.V_FY]] = camera.fx, camera.fy
    left, right, top, bottom = camera.edges
    slack_x, slack_y = SLACK * (right - left), SLACK * (bottom - top)
    view[[layout.V_X_MIN, layout.V_X_MAX]] = left - slack_x, right + slack_x
    view[[layout.V_Y_MIN, layout.V_Y_MAX]] = top - slack_y, bottom + slack_y
    view[layout.V_NEAR] = near
    view[[layout.V_CX, layout.V_CY]] = camera.cx, camera.cy
    view[[layout.V_WIDTH, layout.V_HEIGHT]] = camera.width, camera.height
    if not np.isfinite(view).all():
        raise OptionError("the camera's principal point, rotation or translation is not finite")
    return view.astype(np.float32)


def tile_grid(camera: Camera) -> tuple[int, int]:
    """Give the number of columns and rows of tiles."""
    return -(-camera.width // layout.TILE_WIDTH), -(-camera.height // layout.TILE_HEIGHT)
