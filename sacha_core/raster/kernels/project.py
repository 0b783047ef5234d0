"""First stage: project Gaussians and emit one key for every tile that they touch."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sacha_core.raster.kernels.geometry import (
    LOG2_E,
    camera_rows,
    covariance,
    dot3,
    jacobian,
    load_quaternions,
    log2,
    rotation_matrix,
    to_camera,
)
from sacha_core.raster.kernels.lanes import (
    LANES,
    ceiling,
    floor,
    load,
    load_spread,
    load_strided,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    store,
    zeros,
)
from sacha_core.raster.kernels.layout import (
    ALPHA_MIN,
    KEY_ROW,
    KEY_TILE,
    POWER_SCALE,
    R_COLOUR,
    RADIUS_MAX,
    RECORD,
    TILE_HEIGHT,
    TILE_WIDTH,
    V_CX,
    V_CY,
    V_FX,
    V_FY,
    V_HEIGHT,
    V_NEAR,
    V_WIDTH,
)

F = np.float32
LOG2_255 = F(np.log2(255.0))
TWICE_LN2 = F(2 * np.log(2.0))
BOX_MARGIN = F(2e-3)  # pixels; more than the rounding of a box's edge in an image of 16384 pixels
FAR = F(1e15)  # squares stay finite
HUGE = F(1e30)
EXACT_FROM = 4  # tiles a splat may touch before its outline, not its box, picks them

# planes of one block in the scratch; 0 to 5 are the record's
P_X_LOW, P_X_HIGH, P_Y_LOW, P_Y_HIGH, P_SHEAR, P_SPREAD, P_INVERSE, P_LIMIT, P_APEX, P_KEEP, P_PX, P_PY, P_RY = range(
    6, 19
)
PROJECT_SCRATCH = 19 * LANES


@njit
def project_block(means, scales, quaternions, opacities, row, view, depth, at, scratch):
    """Project sixteen Gaussians from `row` on into the planes of `scratch`; their depths go to depth[at:]."""
    x, y, z = to_camera(means, row, view)
    inverse, _, _, j00, j02, j11, j12 = jacobian(x, y, z, view)
    mean_x, mean_y = load_spread(view, V_FX) * x * inverse, load_spread(view, V_FY) * y * inverse
    m00, m01, m02 = camera_rows(j00, j02, view, 0)
    m10, m11, m12 = camera_rows(j11, j12, view, 1)

    qw, qx, qy, qz, square, _ = load_quaternions(quaternions, row)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix(qw, qx, qy, qz)
    s0, s1, s2 = (
        load_strided(scales, 3 * row, 3, 0),
        load_strided(scales, 3 * row, 3, 1),
        load_strided(scales, 3 * row, 3, 2),
    )
    u0, u1, u2 = (
        dot3(m00, m01, m02, r00, r10, r20) * s0,
        dot3(m00, m01, m02, r01, r11, r21) * s1,
        dot3(m00, m01, m02, r02, r12, r22) * s2,
    )
    v0, v1, v2 = (
        dot3(m10, m11, m12, r00, r10, r20) * s0,
        dot3(m10, m11, m12, r01, r11, r21) * s1,
        dot3(m10, m11, m12, r02, r12, r22) * s2,
    )

    xx, yy, xy, determinant = covariance(u0, u1, u2, v0, v1, v2)
    conic = splat(F(1)) / determinant

    opacity = load(opacities, row)
    solid = (opacity >= ALPHA_MIN) & (opacity < HUGE)
    log_opacity = log2(select(solid, opacity, splat(F(1))))
    limit = (log_opacity + LOG2_255) * TWICE_LN2  # Mahalanobis distance squared at which alpha is 1/255
    radius_x, radius_y = square_root(xx * limit), square_root(yy * limit)

    centre_x, centre_y = mean_x + load_spread(view, V_CX), mean_y + load_spread(view, V_CY)
    reach_x, reach_y = radius_x + (BOX_MARGIN - F(0.5)), radius_y + (BOX_MARGIN - F(0.5))
    x_low = maximum(ceiling(centre_x - reach_x - F(1)), zeros())
    y_low = maximum(ceiling(centre_y - reach_y - F(1)), zeros())
    x_high = minimum(floor(centre_x + reach_x), load_spread(view, V_WIDTH) - F(1))
    y_high = minimum(floor(centre_y + reach_y), load_spread(view, V_HEIGHT) - F(1))

    # every test is false for what is not a number
    keep = solid & (z > load_spread(view, V_NEAR)) & (z < FAR) & (square > F(1e-16)) & (square < HUGE)
    keep = keep & (radius_x < RADIUS_MAX) & (radius_y < RADIUS_MAX) & (x_low <= x_high) & (y_low <= y_high)
    keep = keep & (centre_x - centre_x <= F(0)) & (centre_y - centre_y <= F(0)) & (conic > F(0))

    scale = splat(F(float(LOG2_E) / POWER_SCALE))
    store(depth, at, z)
    store(scratch, 0 * LANES, mean_x)
    store(scratch, 1 * LANES, mean_y)
    store(scratch, 2 * LANES, yy * conic * scale * F(-0.5))
    store(scratch, 3 * LANES, xy * conic * scale)
    store(scratch, 4 * LANES, xx * conic * scale * F(-0.5))
    store(scratch, 5 * LANES, log_opacity * F(1 / POWER_SCALE))
    store(scratch, P_X_LOW * LANES, x_low)
    store(scratch, P_X_HIGH * LANES, x_high)
    store(scratch, P_Y_LOW * LANES, y_low)
    store(scratch, P_Y_HIGH * LANES, y_high)
    inverse_xx = splat(F(1)) / xx
    store(scratch, P_SHEAR * LANES, xy * inverse_xx)
    store(scratch, P_SPREAD * LANES, determinant * inverse_xx)
    store(scratch, P_INVERSE * LANES, inverse_xx)
    store(scratch, P_LIMIT * LANES, limit)
    store(scratch, P_APEX * LANES, xy * radius_y / yy)
    store(scratch, P_KEEP * LANES, select(keep, splat(F(1)), zeros()))
    store(scratch, P_PX * LANES, centre_x)
    store(scratch, P_PY * LANES, centre_y)
    store(scratch, P_RY * LANES, radius_y)


@njit
def outline(lane, column, sign, scratch):
    """Give how far the outline of a splat rises (sign 1) or falls (-1) within a column of tiles: row of its extreme, a real number."""
    left = F(column * TILE_WIDTH) + F(0.5) - scratch[P_PX * LANES + lane]
    apex = sign * scratch[P_APEX * LANES + lane]
    nearest = min(max(apex, left), left + F(TILE_WIDTH - 1))
    rise = scratch[P_RY * LANES + lane]
    if nearest != apex:
        inside = scratch[P_LIMIT * LANES + lane] - nearest * nearest * scratch[P_INVERSE * LANES + lane]
        rise = sign * scratch[P_SHEAR * LANES + lane] * nearest + math.sqrt(
            max(inside * scratch[P_SPREAD * LANES + lane], F(0))
        )
    return scratch[P_PY * LANES + lane] + sign * (rise + BOX_MARGIN) - F(0.5)


@njit
def emit_column(keys, position, column, columns, y_low, y_high):
    """Write the keys of one column of tiles for the rows y_low to y_high; give the next free position."""
    first, last = y_low // TILE_HEIGHT, y_high // TILE_HEIGHT
    for row in range(first, last + 1):
        top = y_low - row * TILE_HEIGHT if row == first else 0
        bottom = y_high - row * TILE_HEIGHT if row == last else TILE_HEIGHT - 1
        keys[position] = (row * columns + column) << KEY_TILE | top << KEY_ROW | bottom
        position += 1
    return position


@njit
def emit(lane, keys, position, columns, scratch):
    """Write the keys of one Gaussian; give the next free position, or -1 where there is no room."""
    x_low, x_high = int(scratch[P_X_LOW * LANES + lane]), int(scratch[P_X_HIGH * LANES + lane])
    y_low, y_high = int(scratch[P_Y_LOW * LANES + lane]), int(scratch[P_Y_HIGH * LANES + lane])
    left, right = x_low // TILE_WIDTH, x_high // TILE_WIDTH
    tiles = (right - left + 1) * (y_high // TILE_HEIGHT - y_low // TILE_HEIGHT + 1)
    if position + tiles > len(keys):
        return -1
    if tiles <= EXACT_FROM:
        for column in range(left, right + 1):
            position = emit_column(keys, position, column, columns, y_low, y_high)
        return position
    for column in range(left, right + 1):
        top = max(math.ceil(outline(lane, column, F(-1), scratch)), y_low)
        bottom = min(math.floor(outline(lane, column, F(1), scratch)), y_high)
        if top <= bottom:
            position = emit_column(keys, position, column, columns, top, bottom)
    return position


@njit(cache=True, nogil=True)
def project(
    means, scales, quaternions, opacities, tail_means, tail_scales, tail_quaternions, tail_opacities, colours, n, channels,
    view, start, stop, base, columns, records, depth, keys, first, count, scratch,
):  # fmt: skip
    """Project the Gaussians `start` to `stop` (`start` a multiple of 16), emitting into `keys`, a slice that begins at entry `base`.

    All arrays are flat. The `tail_` arrays hold the last n % 16 rows, filled up to sixteen.
    Gives the number of keys, or -1 where `keys` is too short.
    """
    position = 0
    for block in range(start, stop, LANES):
        if block + LANES <= n:
            project_block(means, scales, quaternions, opacities, block, view, depth, block, scratch)
        else:
            project_block(tail_means, tail_scales, tail_quaternions, tail_opacities, 0, view, depth, block, scratch)
        for lane in range(min(LANES, n - block)):
            g = block + lane
            first[g] = base + position
            count[g] = 0
            if scratch[P_KEEP * LANES + lane] == F(0):
                continue
            after = emit(lane, keys, position, columns, scratch)
            if after < 0:
                return -1
            count[g] = after - position
            position = after
            for k in range(R_COLOUR):
                records[g * RECORD + k] = scratch[k * LANES + lane]
            for k in range(channels):
                records[g * RECORD + R_COLOUR + k] = colours[g * channels + k]
    return position
