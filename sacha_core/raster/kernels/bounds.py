"""How far pictures of Gaussians reach, without projecting them in full."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    load_first,
    load_spread,
    maximum,
    minimum,
    number,
    select,
    splat,
    square_root,
)
from sacha_core.parallel.kernels.rows import load_columns
from sacha_core.raster.kernels.geometry import jacobian, log2, turned
from sacha_core.raster.kernels.layout import (
    ALPHA_MIN,
    BOX_MARGIN,
    DILATION,
    RADIUS_MAX,
    V_CX,
    V_CY,
    V_FX,
    V_FY,
    V_HEIGHT,
    V_NEAR,
    V_ROTATION,
    V_TRANSLATION,
    V_WIDTH,
)
from sacha_core.raster.kernels.project import FAR, HUGE, LOG2_255, TWICE_LN2

F = np.float32
ROUNDING = F(1 + 1e-5)  # a hundred roundings between a ball's radius and that of the ellipsoid in it


@kernel
def reach(start, stop, means, scales, opacities, view):
    """Give a box that no picture of the Gaussians `start` to `stop` leaves: left, top, right, bottom, pixels; left > right for none.

    A Gaussian counts as a ball of its longest axis. What `project` culls for its depth, its opacity or its place beside the image
    is left out; the rest of the box may lie beside the image.

    Args:
        start: first row.
        stop: end of the range.
        means: (n, 3) metres.
        scales: (n, 3) metres.
        opacities: (n,).
        view: parameters of the camera.
    """
    means, scales = means.reshape(means.size), scales.reshape(scales.size)
    infinite = splat(F(np.inf))
    left, top, right, bottom = infinite, infinite, -infinite, -infinite
    for row in range(start, stop, LANES):
        count = stop - row
        x, y, z = load_columns(means, 3 * row, 3, count)
        x, y, z = (
            turned(view, V_ROTATION, x, y, z) + load_spread(view, V_TRANSLATION),
            turned(view, V_ROTATION + 3, x, y, z) + load_spread(view, V_TRANSLATION + 1),
            turned(view, V_ROTATION + 6, x, y, z) + load_spread(view, V_TRANSLATION + 2),
        )
        inverse, _, _, j00, j02, j11, j12 = jacobian(x, y, z, view)
        s0, s1, s2 = load_columns(scales, 3 * row, 3, count)
        longest = maximum(maximum(absolute(s0), absolute(s1)), absolute(s2))
        square = longest * longest
        opacity = load_first(opacities, row, count)
        solid = (opacity >= ALPHA_MIN) & (opacity < HUGE)
        limit = (log2(select(solid, opacity, splat(F(1)))) + LOG2_255) * TWICE_LN2
        radius_x = square_root(limit * (square * (j00 * j00 + j02 * j02) + DILATION))
        radius_y = square_root(limit * (square * (j11 * j11 + j12 * j12) + DILATION))
        radius_x = minimum(radius_x, splat(RADIUS_MAX)) * ROUNDING + F(2) * BOX_MARGIN
        radius_y = minimum(radius_y, splat(RADIUS_MAX)) * ROUNDING + F(2) * BOX_MARGIN
        centre_x = load_spread(view, V_FX) * x * inverse + load_spread(view, V_CX)
        centre_y = load_spread(view, V_FY) * y * inverse + load_spread(view, V_CY)
        keep = solid & (z > load_spread(view, V_NEAR)) & (z < FAR)
        keep = keep & (centre_x + radius_x > F(0)) & (centre_x - radius_x < load_spread(view, V_WIDTH))
        keep = keep & (centre_y + radius_y > F(0)) & (centre_y - radius_y < load_spread(view, V_HEIGHT))
        left = minimum(left, select(keep, centre_x - radius_x, infinite))
        top = minimum(top, select(keep, centre_y - radius_y, infinite))
        right = maximum(right, select(keep, centre_x + radius_x, -infinite))
        bottom = maximum(bottom, select(keep, centre_y + radius_y, -infinite))
    sides = (number(left, 0), number(top, 0), number(right, 0), number(bottom, 0))
    for lane in range(1, LANES):
        sides = (
            min(sides[0], number(left, lane)), min(sides[1], number(top, lane)),
            max(sides[2], number(right, lane)), max(sides[3], number(bottom, lane)),
        )  # fmt: skip
    return sides
