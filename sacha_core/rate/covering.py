r"""How much of the pictures each Gaussian makes up, and what is too little for its bits.

What a picture changes by without one Gaussian alone (`visibility`) is small for each of many that lie over one another, and large for all
of them. What they add up to is their blending weight: faint layers change pictures together as one, so the weight counts as it is, not
squared. It is small beside what a level loses anyway where it is small beside the root of a bit's price. On avatars of many faint layers
this saves 4 % of the bytes; on trained ones, which have few, it leaves nearly all.

Source: own; blending weight times a power of the volume is the score of LightGaussian (Fan et al., 2023).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import draw
from sacha_core.rate.views import Shot
from sacha_core.rate.visibility import STOCK_SHARE, Grounds
from sacha_core.rate.world import in_world

__all__ = ["COVER", "cover_enough", "covers", "mean_weights"]

COVER = 8.0  # pixels' weight for each root of a bit's price; 5 is as good on each kind of avatar, 11 too much


def mean_weights(
    gaussians: Gaussians, shots: Sequence[Shot], rasteriser: Rasteriser | None = None
) -> Float[np.ndarray, " n"]:
    """Give the blending weight of each Gaussian: summed over pixels, mean over views."""
    rasteriser, total = rasteriser or Rasteriser(), np.zeros(len(gaussians))
    for shot in shots:
        world = in_world(gaussians, shot)
        for camera in shot.cameras:
            frame = draw(gaussians, world, camera, rasteriser)
            ones = np.ones((1, *frame.transmittance.shape), np.float32)
            total += rasteriser.colour_weights(frame, ones)[:, 0]
    return total / max(sum(len(shot.cameras) for shot in shots), 1)


def covers(gaussians: Gaussians, grounds: Grounds, rasteriser: Rasteriser | None = None) -> Float[np.ndarray, " n"]:
    """Give how much of the pictures each Gaussian makes up, pixels of a view; small ones, which cost no fewer bits, count less.

    Args:
        gaussians: n of them.
        grounds: the views; what only stock expressions show counts a quarter.
        rasteriser: one to use again; a new one by default.
    """
    elsewhere = STOCK_SHARE * mean_weights(gaussians, grounds.stock, rasteriser)
    weight = np.maximum(mean_weights(gaussians, grounds.own, rasteriser), elsewhere)
    with np.errstate(over="ignore"):  # endless ones count as large
        return light_gaussian_score(weight, np.exp(gaussians.log_scale.astype(np.float64)))


def cover_enough(
    cover: Float[np.ndarray, " n"], price: float, factors: Float[np.ndarray, " n"] | None = None
) -> Int[np.ndarray, " m"]:
    """Give the rows of the Gaussians that make up enough of the pictures for their bits.

    Args:
        cover: (n,) as `covers` gives it.
        price: squared change of pictures that a bit is worth.
        factors: (n,) how many times as much a squared change by each counts; once by default.
    """
    counted = cover if factors is None else cover * np.sqrt(factors)
    return np.flatnonzero(counted >= COVER * np.sqrt(price))
