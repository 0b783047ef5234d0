"""PIS, the perceptual importance score."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.density.scores.volume import POWER, volume_factor

__all__ = ["perceptual_score"]


def perceptual_score(
    weight: Float[np.ndarray, " n"],
    sensitive_weight: Float[np.ndarray, " n"],
    sensitivity: Float[np.ndarray, " n"],
    scales: Float[np.ndarray, "n 3"],
    pixel_factor: float = 1.0,
    gaussian_factor: float = 1.0,
    percentile: float = 90.0,
    power: float = POWER,
) -> Float[np.ndarray, " n"]:
    """Score Gaussians by their part in the pictures, more where the eye would notice.

    Args:
        weight: (n,) blending weight summed over pixels and views.
        sensitive_weight: (n,) the same sum with each pixel weighted by its reference sensitivity.
        sensitivity: (n,) learnt, in (0, 1).
        scales: (n, 3) standard deviations, of one space.
        pixel_factor: how much a sensitive pixel counts beyond an ordinary one (lambda_S).
        gaussian_factor: how much a fully sensitive Gaussian counts beyond an insensitive one (lambda_a).
        percentile: of the volumes that counts as 1, and above (V90).
        power: of the volume.

    Returns:
        (n,) float64, not negative; 0 exactly for what no view shows.

    Source: SACHA, importance score q; volume factor of LightGaussian.
    """
    seen = np.asarray(weight, np.float64) + pixel_factor * np.asarray(sensitive_weight, np.float64)
    volume = volume_factor(scales, percentile, power=power)
    score: np.ndarray = seen * (1 + gaussian_factor * np.asarray(sensitivity, np.float64)) * volume
    return score
