"""What growth is decided by, summed on a device."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

__all__ = ["gradient_lengths"]


def gradient_lengths(gradient: Float[Tensor, "c n 2"], width: int, height: int, views: int) -> Float[Tensor, " n"]:
    """Give the lengths of the gradients by the places of Gaussians in images, in normalised device units, summed over the images.

    Args:
        gradient: (c, n, 2) of the mean loss over all views of a step, per pixel, or the sums of its absolute values; 0 where an image does
            not show a Gaussian.
        width: of the images, pixels.
        height: likewise.
        views: how many the mean is over; each counts as if it had been alone.

    Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 5.2; Ye et al., AbsGS, 2024 (absolute values).
    """
    return torch.hypot(gradient[..., 0] * (width / 2 * views), gradient[..., 1] * (height / 2 * views)).sum(0)
