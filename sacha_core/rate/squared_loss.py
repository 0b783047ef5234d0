"""The squared difference of two pictures, which is what PSNR sees, and its gradient.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Shaped

from sacha_core.perception.image_loss import ImageLosses

__all__ = ["squared_loss"]


def squared_loss(
    image: Float[np.ndarray, "c h w"],
    target: Shaped[np.ndarray, "c3 h w"],
    sensitivity: Shaped[np.ndarray, "h w"] | None = None,  # noqa: ARG001 (this loss has no use for it)
    pixels: int | None = None,
) -> ImageLosses:
    """Compare a picture with its target; called as `sacha_core.perception.image_loss.ImageLoss` is.

    Args:
        image: (c, h, w) as blended; channels after the target's have no gradient.
        target: (c3, h, w) uint8, or float32 in [0, 1].
        sensitivity: not used.
        pixels: number of pixels that the mean is taken over; those of `image` by default.
    """
    colours, height, width = target.shape
    wanted = target.astype(np.float32) / 255 if target.dtype == np.uint8 else target
    count = colours * (height * width if pixels is None else pixels)
    difference = np.clip(image[:colours], 0, 1) - wanted
    gradient = np.zeros_like(image)
    gradient[:colours] = difference * np.float32(2 / count)
    total = float((difference * difference).sum(dtype=np.float64)) / count
    return ImageLosses(0.0, 0.0, 0.0, total, gradient)
