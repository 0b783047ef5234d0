"""First stage: project Gaussians into records of one cache line, and emit their keys."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    ceiling,
    floor,
    inlined,
    load,
    load_spread,
    load_strided,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    store,
    store_transposed,
    within,
    zeros,
)
from sacha_core.raster.kernels.emit import emit_block
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
from sacha_core.raster.kernels.layout import (
    ALPHA_MIN,
    BOX_MARGIN,
    POWER_SCALE,
    RADIUS_MAX,
    RECORD,
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
FAR = F(1e15)  # squares stay finite
HUGE = F(1e30)


@inlined
def project_block(means, scales, quaternions, opacities, colours, channels, row, view, at, records, depth):
    """Project sixteen Gaussians from `row` on into the records and depths from `at` on.

    Gives which are seen, the box of each in pixels and its outline, as `emit_block` wants them.
    """
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
    keep = solid & (z > load_spread(view, V_NEAR)) & (z < FAR) & (square > F(1e-16)) & (square < HUGE) & (conic > F(0))
    keep = keep & (radius_x < RADIUS_MAX) & (radius_y < RADIUS_MAX) & (x_low <= x_high) & (y_low <= y_high)
    store(depth, at, select(keep, z, splat(F(np.inf))))

    scale = conic * F(float(LOG2_E) / POWER_SCALE)
    red, green, blue, other = load_colours(colours, channels, row)
    store_transposed(records, at * RECORD, (
        mean_x, mean_y,
        yy * scale * F(-0.5), xy * scale, xx * scale * F(-0.5), log_opacity * F(1 / POWER_SCALE),
        red, green, blue, other,
        zeros(), zeros(), zeros(), zeros(), zeros(), zeros(),
    ))  # fmt: skip
    inverse_xx = splat(F(1)) / xx
    outline = (
        centre_x,
        centre_y - F(0.5),
        limit,
        xy * inverse_xx,
        determinant * inverse_xx,
        inverse_xx,
        xy * radius_y / yy,
    )
    return keep, (x_low, x_high, y_low, y_high), outline


@within
def load_colours(colours, channels, row):
    """Give the colour channels of sixteen Gaussians, zero beyond the last."""
    if channels == 4:
        return (
            load_strided(colours, 4 * row, 4, 0), load_strided(colours, 4 * row, 4, 1),
            load_strided(colours, 4 * row, 4, 2), load_strided(colours, 4 * row, 4, 3),
        )  # fmt: skip
    if channels == 3:
        return (
            load_strided(colours, 3 * row, 3, 0), load_strided(colours, 3 * row, 3, 1), load_strided(colours, 3 * row, 3, 2),
            zeros(),
        )  # fmt: skip
    if channels == 2:
        return load_strided(colours, 2 * row, 2, 0), load_strided(colours, 2 * row, 2, 1), zeros(), zeros()
    return load(colours, row), zeros(), zeros(), zeros()


@kernel
def project(
    means, scales, quaternions, opacities, colours,
    tail_means, tail_scales, tail_quaternions, tail_opacities, tail_colours,
    n, channels, view, columns, start, stop, records, depth, base, keys, span, histogram, scratch,
):  # fmt: skip
    """Project the Gaussians `start` to `stop` (`start` a multiple of 16) into their records, and emit their keys.

    All arrays are flat. The `tail_` arrays hold the last n % 16 rows, filled up to sixteen; `columns` is the number of columns of tiles.
    Results are the `records` (n, 16); the `depth` (n,), infinite for what cannot be seen; the `keys`, one for every tile that a Gaussian
    touches, of which keys[0] has the position `base` among all; the `span` (n, 2), position of each Gaussian's first key and number of
    its keys; and the `histogram` (tiles,), number of keys of each tile. `scratch` is (EMIT_SCRATCH,) integers.

    Returns:
        How much of `keys` is used, or -1 where there is no room.
    """
    for tile in range(len(histogram)):
        histogram[tile] = 0
    used = np.int64(0)
    row = start
    for block in range(start, stop, LANES):
        if block + LANES > n:
            means, scales, quaternions, opacities, colours = (
                tail_means, tail_scales, tail_quaternions, tail_opacities, tail_colours,
            )  # fmt: skip
            row = np.int64(0)
        keep, box, outline = project_block(
            means, scales, quaternions, opacities, colours, channels, row, view, block, records, depth
        )
        used = emit_block(keep, box, outline, columns, block, base, used, keys, span, histogram, scratch)
        if used < 0:
            return -1
        row += LANES
    return used
