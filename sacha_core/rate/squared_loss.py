"""The squared difference of two pictures, which is what PSNR sees, and its gradient.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Shaped

from sacha_core.perception.image_loss import Box, ImageLosses

__all__ = ["squared_loss"]


def squared_loss(
    image: Float[np.ndarray, "c h w"],
    target: Shaped[np.ndarray, "c3 h0 w0"],
    sensitivity: Shaped[np.ndarray, "h0 w0"] | None = None,  # noqa: ARG001 (this loss has no use for it)
    box: Box | None = None,
) -> ImageLosses:
    """Compare a picture with its target; called as `sacha_core.perception.image_loss.ImageLoss` is.

    Args:
        image: (c, h, w) as blended; channels after the target's have no gradient.
        target: (c3, h0, w0) uint8, or float32 in [0, 1].
        sensitivity: not used.
        box: left, top, right, bottom of the part of the target that `image` shows; None for all. The mean is over all of it.
    """
    colours, height, width = target.shape
    left, top, right, bottom = box or (0, 0, width, height)
    part = target[:, top:bottom, left:right]
    wanted = part.astype(np.float32) / 255 if target.dtype == np.uint8 else part
    count = target.size
    difference = np.clip(image[:colours], 0, 1) - wanted
    gradient = np.zeros_like(image)
    gradient[:colours] = difference * np.float32(2 / count)
    total = float((difference * difference).sum(dtype=np.float64)) / count
    return ImageLosses(0.0, 0.0, 0.0, total, gradient)
