"""Light that reaches points from a sphere of directions, shadowed by the head itself."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.synthesis.kernels.surface import SUBPIXEL_BITS
from sacha_core.synthesis.kernels.triangles import rasterise

FAST = {"contract", "nsz", "arcp", "reassoc"}
UNIT = 1 << SUBPIXEL_BITS
FARTHEST = np.float32(4.0)  # metres: larger than any head, so that nearness along a direction stays positive


@kernel
def depth_map(vertices, faces, axes, centre, radius, ids, nearness, screen, height):
    """Draw the mesh as seen from direction `axes[2]`, without perspective; fills `nearness` (m, m).

    `axes` (3, 3): right, up, and the direction towards the light. A map spans `radius` metres around `centre`.
    """
    ids[:] = -1
    nearness[:] = 0
    scale = ids.shape[0] * 0.5 / radius
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0] - centre[0], vertices[v, 1] - centre[1], vertices[v, 2] - centre[2]
        u = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z + radius) * scale
        w = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z + radius) * scale
        screen[v, 0] = np.int32(np.floor(u * UNIT + 0.5))
        screen[v, 1] = np.int32(np.floor(w * UNIT + 0.5))
        height[v] = FARTHEST + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
    rasterise(screen, height, faces, 0, ids, nearness)


@kernel(fastmath=FAST)
def gather_light(points, normals, nearness, axes, radiance, wrap, centre, radius, bias, slope_bias, irradiance):
    """Add what one direction gives to `irradiance` (n, 3).

    Light wraps around the terminator by `wrap` (3,) for each colour, as it does where it scatters under skin. A point is in shadow where
    the map has something nearer to the light by more than a bias; four texels are blended.
    """
    size = nearness.shape[0]
    scale = size * 0.5 / radius
    for i in range(len(points)):
        facing = axes[2, 0] * normals[i, 0] + axes[2, 1] * normals[i, 1] + axes[2, 2] * normals[i, 2]
        if facing <= -wrap[0]:
            continue
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        u = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z + radius) * scale - np.float32(0.5)
        w = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z + radius) * scale - np.float32(0.5)
        h = FARTHEST + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        h += bias + slope_bias * (np.float32(1) - min(max(facing, np.float32(0)), np.float32(1)))
        column, row = int(np.floor(u)), int(np.floor(w))
        seen = np.float32(1)
        if 0 <= column < size - 1 and 0 <= row < size - 1:
            a, b = u - column, w - row
            one = np.float32(1)
            seen = (one - a) * (one - b) * (nearness[row, column] <= h) + a * (one - b) * (
                nearness[row, column + 1] <= h
            )
            seen += (one - a) * b * (nearness[row + 1, column] <= h) + a * b * (nearness[row + 1, column + 1] <= h)
        if seen <= 0:
            continue
        for k in range(3):
            lit = (facing + wrap[k]) / (np.float32(1) + wrap[k])
            if lit > 0:
                irradiance[i, k] += seen * lit * radiance[k]
