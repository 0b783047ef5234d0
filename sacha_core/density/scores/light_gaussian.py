"""LGS, LightGaussian's global significance score."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.density.scores.volume import POWER, volume_factor

__all__ = ["light_gaussian_score"]


def light_gaussian_score(
    weight: Float[np.ndarray, " n"],
    scales: Float[np.ndarray, "n 3"],
    variant: Literal["paper", "code"] = "paper",
    power: float = POWER,
) -> Float[np.ndarray, " n"]:
    """Score Gaussians by their part in the pictures and their volume.

    Args:
        weight: (n,) summed over pixels and views: the blending weight alpha T for `paper`; for `code`, what their kernel adds, which is
            opacity T without the Gaussian's fall-off.
        scales: (n, 3) standard deviations, of one space.
        variant: `paper` takes volumes relative to the 90th percentile and at most 1; `code`, as released, relative to the 10th, with no
            bound.
        power: of the volume.

    Source: Fan et al., LightGaussian, 2023.
    """
    factor = (
        volume_factor(scales, power=power)
        if variant == "paper"
        else volume_factor(scales, 10.0, clamp=False, power=power)
    )
    score: np.ndarray = np.asarray(weight, np.float64) * factor
    return score
