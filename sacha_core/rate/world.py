"""Gaussians in the world of a shot, by compiled loops: many poses of many Gaussians are looked at when numbers are weighed.

Source: own.
"""

from __future__ import annotations

import numpy as np

from sacha_core.animation.carry import room_for
from sacha_core.animation.kernels.carry import carry
from sacha_core.avatar.binding import WorldGaussians, sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.rate.views import Shot

__all__ = ["in_world"]


def in_world(gaussians: Gaussians, shot: Shot) -> WorldGaussians:
    """Carry Gaussians along with the triangles of a shot: the compiled twin of `sacha_core.avatar.binding.to_world`.

    Args:
        gaussians: n of them, bound to triangles that there are.
        shot: the pose.
    """
    means, scales, quaternions = room_for(len(gaussians))
    frames = shot.frames
    with np.errstate(over="ignore"):  # a Gaussian without end is culled when it is drawn
        np.exp(gaussians.log_scale, out=scales)
    carry(
        0, len(gaussians), gaussians.position, scales, gaussians.quaternion, gaussians.binding,
        frames.rotation, frames.scale, frames.origin, shot.quaternions, means, scales, quaternions,
    )  # fmt: skip
    opacities = sigmoid(gaussians.opacity_logit).astype(np.float32, copy=False)
    return WorldGaussians(means, scales, quaternions, opacities)
