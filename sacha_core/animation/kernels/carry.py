"""Bound Gaussians into the world, in the dtype of the arrays.

Ranges begin at multiples of `BLOCK`, so that a Gaussian falls into the same lane of a vector whichever thread carries it.
"""

from __future__ import annotations

import math

from sacha_core.parallel.kernels.kernel import kernel

FAST = {"contract", "nsz", "arcp", "reassoc"}
BLOCK = 64  # more lanes than any vector has, unrolled
SMALLEST_NORM = 1e-12  # as `geometry.quaternion` has it


@kernel(error_model="numpy", fastmath=FAST)
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
        for c in range(3):  # no slice of the frame, which would cost counting references to it
            means[i, c] = (
                f_rotation[f, c, 0] * px + f_rotation[f, c, 1] * py + f_rotation[f, c, 2] * pz + f_origin[f, c]
            )
        scales[i, 0], scales[i, 1], scales[i, 2] = k * scale[i, 0], k * scale[i, 1], k * scale[i, 2]
        w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
        norm = max(math.sqrt(w * w + x * x + y * y + z * z), smallest)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        aw, ax, ay, az = f_quaternion[f, 0], f_quaternion[f, 1], f_quaternion[f, 2], f_quaternion[f, 3]
        turned[i, 0] = aw * w - ax * x - ay * y - az * z
        turned[i, 1] = aw * x + ax * w + ay * z - az * y
        turned[i, 2] = aw * y - ax * z + ay * w + az * x
        turned[i, 3] = aw * z + ax * y - ay * x + az * w
