"""MRS, the removal score: what pictures change by when one Gaussian is removed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["removal_score"]


def removal_score(
    change: Float[np.ndarray, " n"],
    sensitive_change: Float[np.ndarray, " n"],
    sensitivity: Float[np.ndarray, " n"],
    pixel_factor: float = 0.0,
    gaussian_factor: float = 0.0,
) -> Float[np.ndarray, " n"]:
    """Score Gaussians by what removing each alone would change.

    A blending weight tells how much of a picture is a Gaussian's; this tells how much of it would be missed: the weight times how far its
    colour is from that of what lies behind, which would be seen in its stead. A Gaussian before others of its own colour has a large weight
    and little worth.

    The change is that of the picture, not of its error against the truth, which ranks badly: there each Gaussian is judged by the same
    residual, a third of them are better away alone, and taking many of those away over-corrects it.

    Args:
        change: (n,) squared or absolute, summed over pixels, colours and views.
        sensitive_change: (n,) the same sum with each pixel weighted by its reference sensitivity.
        sensitivity: (n,) learnt, in (0, 1).
        pixel_factor: how much a sensitive pixel counts beyond an ordinary one (lambda_S).
        gaussian_factor: how much a fully sensitive Gaussian counts beyond an insensitive one (lambda_a).

    Returns:
        (n,) float64, not negative; 0 exactly for what no view shows.

    Source: own.
    """
    cost = np.asarray(change, np.float64) + pixel_factor * np.asarray(sensitive_change, np.float64)
    score: np.ndarray = cost * (1 + gaussian_factor * np.asarray(sensitivity, np.float64))
    return score
