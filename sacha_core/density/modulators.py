"""From mean sensitivities to each region's densification threshold and pruning ratio."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.density.region_means import RegionMeans

__all__ = ["Modulators", "bounded", "controlled", "modulators"]

Modulators = Literal["learned", "inverted", "random", "uniform"]

SMALLEST_MEAN = (
    1e-6  # a sigmoid gives 0 where float32 ends; this keeps a region of vanishing sensitivity finite, and above 0
)


def modulators(means: RegionMeans) -> Float[np.ndarray, " r"]:
    """Give each region's modulator: overall mean over the region's mean; below 1 where people look.

    Returns:
        (r,) positive; exactly 1 where a region has no mean, and everywhere if all sensitivities are equal.

    Source: SACHA, section on semantic-aware density control, equation 8.
    """
    known = np.isfinite(means.region)
    region = np.maximum(means.region, SMALLEST_MEAN, where=known, out=np.ones_like(means.region))
    return np.where(known, max(means.overall, SMALLEST_MEAN) / region, 1.0)


def controlled(modulator: Float[np.ndarray, " r"], mode: Modulators, seed: int) -> Float[np.ndarray, " r"]:
    """Give the modulators that a run uses: those that were learnt, or of an experiment's control.

    Args:
        modulator: (r,) as learnt.
        mode: `learned` leaves them; `inverted` gives one over each, so that regions where people look are starved; `random` gives each
            region that of another, always the same, drawn from the seed; `uniform` gives 1 to all.
        seed: of the run.

    Source: own.
    """
    if mode == "inverted":
        return 1 / modulator
    if mode == "random":
        return modulator[np.random.default_rng([seed, 0, 3]).permutation(len(modulator))]
    return np.ones_like(modulator) if mode == "uniform" else modulator


def bounded(base: float, modulator: Float[np.ndarray, " r"], lowest: float, highest: float) -> Float[np.ndarray, " r"]:
    """Scale a threshold or ratio by the modulators, then clip it: tau_R and rho_R are both made so.

    A low threshold lets a region grow sooner, a low ratio spares it: sensitive regions get both.

    Args:
        base: value of an average region (tau0 or rho0).
        modulator: (r,) of each region.
        lowest: of any region.
        highest: of any region.

    Source: SACHA, section on semantic-aware density control.
    """
    return np.clip(base * modulator, lowest, highest)
