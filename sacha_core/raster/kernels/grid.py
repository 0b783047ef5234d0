"""Where the lanes of each tile lie."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import LANES
from sacha_core.raster.kernels.layout import TILE_WIDTH


@kernel
def place_lanes(cx, cy, x_lanes, y_lanes):
    """Write x of the sixteen lanes of each column of tiles, and y of those of each pair of rows, relative to the principal point.

    Taken from there and not from the image's corner, they are the same to the bit in a cropped camera.
    """
    for k in range(len(x_lanes)):
        column, lane = k // LANES, k % LANES
        x_lanes[k] = np.float32(column * TILE_WIDTH + lane % TILE_WIDTH + 0.5 - cx)
    for k in range(len(y_lanes)):
        y_lanes[k] = np.float32(k // TILE_WIDTH + 0.5 - cy)
