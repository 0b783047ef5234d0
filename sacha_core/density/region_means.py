"""How sensitive each region is: the mean of what its Gaussians have learnt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

__all__ = ["RegionMeans", "region_means"]


@dataclass(frozen=True)
class RegionMeans:
    """Mean sensitivity of each of r regions and of all Gaussians.

    Args:
        region: (r,) NaN where a region has no Gaussian, or none of any weight.
        overall: over all Gaussians, whatever their region; NaN where nothing has weight.
        counts: (r,) Gaussians of each region, of whatever weight.
    """

    region: Float[np.ndarray, " r"]
    overall: float
    counts: Int[np.ndarray, " r"]


def region_means(
    sensitivity: Float[np.ndarray, " n"],
    regions: Integer[np.ndarray, " n"],
    n_regions: int,
    weights: Float[np.ndarray, " n"] | Bool[np.ndarray, " n"] | None = None,
) -> RegionMeans:
    """Average sensitivities by region, in float64.

    Gaussians that are never seen learn nothing and stay near their initial sensitivity, which dilutes a plain mean where many are hidden.
    Weights of 0 and 1 leave those out; summed blending weights count each by how much of it is seen.

    Args:
        sensitivity: (n,) in (0, 1).
        regions: (n,) region of each Gaussian, 0 to n_regions - 1.
        n_regions: number of regions.
        weights: (n,) not negative; None is the plain mean.

    Source: SACHA, equation 8 (plain); the weights are our own.
    """
    factor = np.ones(len(regions)) if weights is None else np.asarray(weights, np.float64)
    least = float(
        np.min(sensitivity, initial=1.0)
    )  # means are taken from there on, so that equal sensitivities have equal means to the bit
    value = (sensitivity - least) * factor
    totals = np.bincount(regions, factor, n_regions)
    sums = np.bincount(regions, value, n_regions)
    overall_total = float(factor.sum())
    return RegionMeans(
        region=least + np.divide(sums, totals, out=np.full(n_regions, np.nan), where=totals > 0),
        overall=least + float(value.sum()) / overall_total if overall_total > 0 else float("nan"),
        counts=np.bincount(regions, minlength=n_regions),
    )
