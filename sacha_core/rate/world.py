"""Gaussians in the world of a pose, by compiled loops: many poses of many Gaussians are looked at when numbers are weighed.

Source: own.
"""

from __future__ import annotations

import numpy as np

from sacha_core.animation.carry import carry
from sacha_core.avatar.binding import WorldGaussians, sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.parallel.pool import Pool
from sacha_core.rate.stances import Stance

__all__ = ["in_world"]


def in_world(gaussians: Gaussians, stance: Stance, pool: Pool | None = None) -> WorldGaussians:
    """Carry Gaussians along with the triangles of a pose: the compiled twin of `sacha_core.avatar.binding.to_world`.

    Args:
        gaussians: n of them, bound to triangles that there are.
        stance: the pose.
        pool: shares out the work; None for the calling thread alone.
    """
    local = gaussians.position, gaussians.log_scale, gaussians.quaternion
    means, scales, quaternions = carry(*local, gaussians.binding, stance, pool)
    opacities = sigmoid(gaussians.opacity_logit).astype(np.float32, copy=False)
    return WorldGaussians(means, scales, quaternions, opacities)
