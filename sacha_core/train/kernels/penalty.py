"""The penalties on Gaussians that stray from their triangle or swell, and a box around their pictures."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def penalise(
    position,
    log_scale,
    visible,
    position_weight,
    position_limit,
    scale_weight,
    scale_limit,
    g_position,
    g_log_scale,
    sums,
):
    """Add both penalties' gradients to those given, and sum the penalties; of visible Gaussians only.

    Args:
        position: (n, 3) float32, local.
        log_scale: (n, 3) float32, local.
        visible: (n,) bool.
        position_weight: float32, of what |mean| exceeds its limit by.
        position_limit: float32, local units.
        scale_weight: float32, of the length of what standard deviations exceed their limit by.
        scale_limit: float32, local units.
        g_position: (n, 3) changed.
        g_log_scale: (n, 3) changed.
        sums: (2,) float64 out, weighted.
    """
    zero = np.float32(0)
    strayed, swollen = 0.0, 0.0
    for row in range(len(visible)):
        if not visible[row]:
            continue
        x, y, z = position[row, 0], position[row, 1], position[row, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        if distance > position_limit:
            strayed += position_weight * (distance - position_limit)
            for axis in range(3):
                g_position[row, axis] += position_weight * position[row, axis] / distance
        excess = zero
        for axis in range(3):
            beyond = max(math.exp(log_scale[row, axis]) - scale_limit, zero)
            excess += beyond * beyond
        if excess > zero:
            length = math.sqrt(excess)
            swollen += scale_weight * length
            for axis in range(3):
                spread = math.exp(log_scale[row, axis])
                g_log_scale[row, axis] += scale_weight * max(spread - scale_limit, zero) / length * spread
    sums[0] = strayed
    sums[1] = swollen


@njit(cache=True, nogil=True)
def image_bounds(means, scales, opacities, rotation, translation, fx, fy, cx, cy, near, bounds):
    """Write a box that no Gaussian's picture leaves: left, top, right, bottom in pixels; left > right if there is none.

    Generous: a Gaussian counts as a ball of its longest axis, out to where an opacity of 1 falls under 1/255.

    Args:
        means: (n, 3) metres.
        scales: (n, 3) metres.
        opacities: (n,).
        rotation: (3, 3) float64, world to camera.
        translation: (3,) float64, likewise.
        fx: pixels, like the next three.
        fy: see `fx`.
        cx: see `fx`.
        cy: see `fx`.
        near: metres; what is closer is not drawn.
        bounds: (4,) float64 out.
    """
    reach = math.sqrt(2 * math.log(255.0))
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for row in range(len(means)):
        if not opacities[row] >= 1 / 255:
            continue
        x, y, z = means[row, 0], means[row, 1], means[row, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
        if not depth > near:
            continue
        u = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0]) / depth
        v = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1]) / depth
        longest = max(scales[row, 0], scales[row, 1], scales[row, 2])
        slant = math.sqrt(1 + u * u + v * v)
        radius = reach * (longest / depth * slant * max(fx, fy) + math.sqrt(0.3)) + 1
        left, right = min(left, fx * u + cx - radius), max(right, fx * u + cx + radius)
        top, bottom = min(top, fy * v + cy - radius), max(bottom, fy * v + cy + radius)
    bounds[0], bounds[1], bounds[2], bounds[3] = left, top, right, bottom
