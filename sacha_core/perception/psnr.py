"""Peak signal-to-noise ratio."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

__all__ = ["psnr", "psnr_over"]

LEAST_ERROR = 1e-12  # mean squared
Image = Float[np.ndarray, "_ _ _"] | UInt8[np.ndarray, "_ _ _"]  # (h, w, c); that two agree is checked where it matters


def psnr(image: Image, reference: Image) -> float:
    """Peak signal-to-noise ratio over all pixels, the white background included.

    Args:
        image: (h, w, c) float in [0, 1] (clamped if beyond), or uint8.
        reference: (h, w, c), likewise.

    Returns:
        Decibels; infinite where both are the same.

    Raises:
        ValueError: their shapes differ.

    Source: definition; clamping as GaussianAvatars evaluates.
    """
    if image.shape != reference.shape:
        raise ValueError(f"images of shapes {image.shape} and {reference.shape} cannot be compared")
    error = float(np.mean(np.square(unit_range(image) - unit_range(reference))))
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def psnr_over(image: Image, reference: Image, pixels: Bool[np.ndarray, "h w"]) -> float:
    """Peak signal-to-noise ratio over some pixels.

    Args:
        image: as of `psnr`.
        reference: likewise.
        pixels: (h, w) which ones count.

    Returns:
        Decibels; 120, so that means stay finite, where hardly anything differs or no pixel counts.

    Source: definition.
    """
    error = np.square(unit_range(image[pixels]) - unit_range(reference[pixels]))
    return float(-10 * np.log10(max(float(error.mean()) if error.size else 0.0, LEAST_ERROR)))


def unit_range(image: Float[np.ndarray, "*shape"] | UInt8[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Give the image in float64 within [0, 1]; uint8 is divided by 255."""
    scaled = image / 255.0 if image.dtype == np.uint8 else np.asarray(image, np.float64)
    return np.clip(scaled, 0.0, 1.0)
