"""Bound Gaussians into the world, in the dtype of the arrays.

Ranges begin at multiples of `BLOCK`, so that a Gaussian falls into the same lane of a vector whichever thread carries it.
"""

from __future__ import annotations

import math

from numba import njit

FAST = {"contract", "nsz", "arcp", "reassoc"}
BLOCK = 64  # more lanes than any vector has, unrolled
SMALLEST_NORM = 1e-12  # as `geometry.quaternion` has it


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def carry(
    start, stop, position, scale, quaternion, binding,
    f_rotation, f_scale, f_origin, f_quaternion, means, scales, turned,
):  # fmt: skip
    """Write world means (n, 3), standard deviations (n, 3) and unit quaternions (n, 4) of the Gaussians `start` to `stop`.

    `start` is a multiple of BLOCK; `scale` holds standard deviations in units of the triangle, and may be the array `scales` itself.
    """
    smallest = position.dtype.type(SMALLEST_NORM)
    for i in range(start, stop):
        f = binding[i]
        k = f_scale[f]
        px, py, pz = k * position[i, 0], k * position[i, 1], k * position[i, 2]
        r, o = f_rotation[f], f_origin[f]
        means[i, 0] = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + o[0]
        means[i, 1] = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + o[1]
        means[i, 2] = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + o[2]
        scales[i, 0], scales[i, 1], scales[i, 2] = k * scale[i, 0], k * scale[i, 1], k * scale[i, 2]
        w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
        norm = max(math.sqrt(w * w + x * x + y * y + z * z), smallest)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        a, b, c, d = f_quaternion[f, 0], f_quaternion[f, 1], f_quaternion[f, 2], f_quaternion[f, 3]
        turned[i, 0] = a * w - b * x - c * y - d * z
        turned[i, 1] = a * x + b * w + c * z - d * y
        turned[i, 2] = a * y - b * z + c * w + d * x
        turned[i, 3] = a * z + b * y - c * x + d * w
