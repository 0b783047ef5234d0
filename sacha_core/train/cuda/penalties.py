"""The penalties on Gaussians that stray from their triangle or swell, on a device: the twin of the CPU engine's."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from sacha_core.train.options import LossOptions

__all__ = ["penalise"]


def penalise(
    position: Float[Tensor, "n 3"],
    log_scale: Float[Tensor, "n 3"],
    visible: Bool[Tensor, "c n"],
    options: LossOptions,
    d_position: Float[Tensor, "n 3"],
    d_log_scale: Float[Tensor, "n 3"],
) -> Float[Tensor, "2"]:
    """Add the gradients of both penalties, and give them, weighted: each a mean over the Gaussians that a view shows, and over views.

    Args:
        position: (n, 3) local.
        log_scale: (n, 3) local.
        visible: (c, n) which Gaussians each view shows.
        options: weights and limits.
        d_position: (n, 3) changed.
        d_log_scale: (n, 3) changed.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.4; gradients own.
    """
    shares = (visible.to(position.dtype) / visible.sum(1, keepdim=True).clamp_min(1)).mean(0)
    distance = position.norm(dim=1)
    strays = (shares > 0) & (distance > options.position_limit)
    weight = shares * options.position
    strayed = torch.where(strays, weight * (distance - options.position_limit), 0).sum()
    d_position += torch.where(strays[:, None], (weight / distance)[:, None] * position, 0)

    scale = log_scale.exp()
    excess = (scale - options.scale_limit).clamp_min(0)
    length = excess.norm(dim=1)
    swells = (shares > 0) & (length > 0)
    weight = shares * options.scale
    swollen = torch.where(swells, weight * length, 0).sum()
    d_log_scale += torch.where(swells[:, None], (weight / length)[:, None] * excess * scale, 0)
    return torch.stack([strayed, swollen])
