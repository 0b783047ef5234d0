"""What the kernels agree on: tile size, thresholds, and where each number lies in the shared arrays.

A tile is 8 pixels wide and 32 high, kept row after row, so that one vector of sixteen lanes covers 8 x 2 pixels. A small splat then wastes
fewer lanes than on rows of sixteen: a box of 10 x 10 pixels touches 12 vectors on average instead of 16.
"""

from __future__ import annotations

import numpy as np

TILE_WIDTH = 8
TILE_HEIGHT = 32
TILE_VECTORS = TILE_WIDTH * TILE_HEIGHT // 16
TILE_PIXELS = TILE_WIDTH * TILE_HEIGHT

# thresholds of the published rasterisers (Kerbl et al. 2023; gsplat), which are part of what an image of Gaussians is
DILATION = np.float32(0.3)  # added to the projected covariance, square pixels
ALPHA_MIN = np.float32(1 / 255)
ALPHA_MAX = np.float32(0.99)
TRANSMITTANCE_MIN = np.float32(1e-4)

BOX_MARGIN = np.float32(2e-3)  # pixels; more than the rounding of a box's edge in an image of 16384 pixels
# a splat wider than this cannot belong to what is drawn; it also catches what is infinite
RADIUS_MAX = np.float32(16384)

# The exponent is kept as log2(alpha) / 8, see `alpha_power`.
POWER_SCALE = 8
POWER_MIN = np.float32(-np.log2(255.0) / POWER_SCALE)

# record of one Gaussian: 16 float32, one cache line
RECORD = 16
R_X, R_Y = 0, 1  # projected mean relative to the principal point, pixels
R_A, R_B, R_C = 2, 3, 4  # log2(alpha) / 8 = A dx^2 + B dx dy + C dy^2 + OPACITY
R_OPACITY = 5
R_COLOUR = 6  # to 9; the rest is free

# gradient sums of one entry (a Gaussian in a tile): 16 float32
E_S, E_X, E_Y, E_XX, E_XY, E_YY = (
    0,
    1,
    2,
    3,
    4,
    5,
)  # sums of s, s dx, s dy, s dx^2, s dx dy, s dy^2; s = alpha dL/dalpha
E_COLOUR = 6

# view parameters, float32
V_ROTATION = 0  # to 8, row by row
V_TRANSLATION = 9  # to 11
V_FX, V_FY = 12, 13
V_X_MIN, V_X_MAX, V_Y_MIN, V_Y_MAX = 14, 15, 16, 17  # where x / z and y / z are clamped in the Jacobian
V_NEAR = 18
V_CX, V_CY = 19, 20
V_WIDTH, V_HEIGHT = 21, 22
VIEW = 23

# A key, emitted by a Gaussian for a tile, is a 32-bit integer: tile << 10 | first row << 5 | last row.
# An entry of a tile's list is a 64-bit integer: position of its key, where its gradients go << 36 | Gaussian << 10 | the same rows.
ROW_BITS = 5
KEY_BITS = 2 * ROW_BITS
GAUSSIAN_SHIFT = KEY_BITS
GAUSSIAN_BITS = 26
TOP_SHIFT = GAUSSIAN_SHIFT + GAUSSIAN_BITS
ROW_MASK = (1 << ROW_BITS) - 1
GAUSSIAN_MASK = (1 << GAUSSIAN_BITS) - 1
