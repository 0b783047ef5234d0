"""A box around the pictures of Gaussians."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


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
