"""Structural similarity."""

from __future__ import annotations

import numpy as np

from sacha_core.perception.image_loss import ImageLoss
from sacha_core.perception.psnr import Image, unit_range

__all__ = ["ssim"]


def ssim(image: Image, reference: Image) -> float:
    """Mean structural similarity: 11 x 11 Gaussian window, sigma 1.5, zero padding, over all pixels and channels.

    Args:
        image: (h, w, c) float in [0, 1] (clamped if beyond), or uint8.
        reference: (h, w, c), likewise.

    Returns:
        At most 1, which means equal.

    Raises:
        ValueError: their shapes differ.

    Source: Wang et al., Image quality assessment, 2004, with the padding that splatting code uses.
    """
    if image.shape != reference.shape:
        raise ValueError(f"images of shapes {image.shape} and {reference.shape} cannot be compared")
    planes = [np.ascontiguousarray(unit_range(x).transpose(2, 0, 1), np.float32) for x in (image, reference)]
    return ImageLoss()(planes[0], planes[1]).ssim
