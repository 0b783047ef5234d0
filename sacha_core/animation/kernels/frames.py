"""Frames of triangles and their quaternions, in the dtype of the vertices.

A range of triangles is worked off in blocks that begin at multiples of `BLOCK`. Corners are gathered into planes, one number of the whole
block after the other, so that the arithmetic runs on full vectors, and results are scattered from there.
"""

from __future__ import annotations

import math

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel

FAST = {"contract", "nsz", "arcp", "reassoc"}
BLOCK = 64  # triangles
# Where a block's planes lie: corners first, whose places the results then take
ORIGIN, QUATERNION, ROTATION, SCALE, SOUND, PLANES = (BLOCK * plane for plane in (0, 3, 9, 18, 19, 20))


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def gather(vertices, faces, first, count, planes):
    """Copy the corners of some triangles to planes 0 to 8."""
    for i in range(count):
        for corner in range(3):
            v = faces[first + i, corner]
            for c in range(3):
                planes[(3 * corner + c) * BLOCK + i] = vertices[v, c]


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def solve(planes, limit, smallest):
    """Turn the corners of a block into frames; SOUND is 1 where a triangle has one, else 0."""
    infinite, zero = planes.dtype.type(np.inf), planes.dtype.type(0)
    half, third, one = planes.dtype.type(0.5), planes.dtype.type(3), planes.dtype.type(1)
    b = BLOCK
    for i in range(BLOCK):
        ax, ay, az = planes[i], planes[b + i], planes[2 * b + i]
        bx, by, bz = planes[3 * b + i], planes[4 * b + i], planes[5 * b + i]
        cx, cy, cz = planes[6 * b + i], planes[7 * b + i], planes[8 * b + i]
        planes[i], planes[b + i], planes[2 * b + i] = (
            (ax + bx + cx) / third,
            (ay + by + cy) / third,
            (az + bz + cz) / third,
        )
        ex, ey, ez = bx - ax, by - ay, bz - az
        hx, hy, hz = cx - ax, cy - ay, cz - az
        nx, ny, nz = ey * hz - ez * hy, ez * hx - ex * hz, ex * hy - ey * hx
        edge_squared, area_squared = ex * ex + ey * ey + ez * ez, nx * nx + ny * ny + nz * nz
        # each is false for what is not a number
        sound = (area_squared > limit * edge_squared * (hx * hx + hy * hy + hz * hz)) & (area_squared < infinite)
        sound = sound & (area_squared >= smallest) & (edge_squared >= smallest)
        planes[SOUND + i] = one if sound else zero
        edge, area = math.sqrt(edge_squared), math.sqrt(area_squared)
        planes[SCALE + i] = (edge + area / edge) * half
        ex, ey, ez = ex / edge, ey / edge, ez / edge
        nx, ny, nz = nx / area, ny / area, nz / area
        ux, uy, uz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx
        planes[ROTATION + i], planes[ROTATION + b + i], planes[ROTATION + 2 * b + i] = ex, nx, ux
        planes[ROTATION + 3 * b + i], planes[ROTATION + 4 * b + i], planes[ROTATION + 5 * b + i] = ey, ny, uy
        planes[ROTATION + 6 * b + i], planes[ROTATION + 7 * b + i], planes[ROTATION + 8 * b + i] = ez, nz, uz
        # Shepperd: the row of 4 q q^T with the largest diagonal entry is q up to a length that is never small
        d0, d1 = one + ex + ny + uz, one + ex - ny - uz
        d2, d3 = one - ex + ny - uz, one - ex - ny + uz
        wx, wy, wz = nz - uy, ux - ez, ey - nx
        xy, xz, yz = nx + ey, ux + ez, uy + nz
        first, second, third_ = d0 >= max(d1, d2, d3), d1 >= max(d2, d3), d2 >= d3
        w = d0 if first else (wx if second else (wy if third_ else wz))
        x = wx if first else (d1 if second else (xy if third_ else xz))
        y = wy if first else (xy if second else (d2 if third_ else yz))
        z = wz if first else (xz if second else (yz if third_ else d3))
        length = math.sqrt(w * w + x * x + y * y + z * z)
        planes[QUATERNION + i], planes[QUATERNION + b + i] = w / length, x / length
        planes[QUATERNION + 2 * b + i], planes[QUATERNION + 3 * b + i] = y / length, z / length


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def scatter(planes, first, count, rotation, scale, origin, quaternion):
    """Copy a block's frames to where they belong; gives the first degenerate triangle, or -1."""
    for i in range(count):
        f = first + i
        if planes[SOUND + i] == 0:
            return f
        for c in range(3):
            origin[f, c] = planes[ORIGIN + c * BLOCK + i]
            for k in range(3):
                rotation[f, c, k] = planes[ROTATION + (3 * c + k) * BLOCK + i]
        scale[f] = planes[SCALE + i]
        for c in range(4):
            quaternion[f, c] = planes[QUATERNION + c * BLOCK + i]
    return -1


@kernel(error_model="numpy", forceinline=True)  # what it calls may round otherwise in other surroundings
def triangle_frames(start, stop, vertices, faces, limit, smallest, rotation, scale, origin, quaternion):
    """Write the frames of the triangles `start` (a multiple of BLOCK) to `stop`, and their quaternions, largest component positive.

    `sacha_core.geometry.triangle` says what a frame is; `limit` is the square of its limit, and `smallest` the smallest normal number.

    Returns:
        The first degenerate triangle, at which the work stops, or -1.
    """
    planes = np.ones(PLANES, vertices.dtype)
    for block in range(start, stop, BLOCK):
        count = min(BLOCK, stop - block)
        gather(vertices, faces, block, count, planes)
        solve(planes, limit, smallest)
        fault = scatter(planes, block, count, rotation, scale, origin, quaternion)
        if fault >= 0:
            return fault
    return -1
