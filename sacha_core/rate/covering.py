r"""How much of the pictures each Gaussian makes up, and what is too little for its bits.

What a picture changes by without one Gaussian alone (`visibility`) is small for each of many that lie over one another, and large for all
of them. What they add up to is their blending weight: faint layers change pictures together as one, so the weight counts as it is, not
squared. It is small beside what a level loses anyway where it is small beside the root of a bit's price. On avatars of many faint layers
this saves 4 % of the bytes; on trained ones, which have few, it leaves nearly all. Fine Gaussians make up more of coarse pictures, which
blur them, than of those that files are judged by: so it is measured there.

Source: own; blending weight times a power of the volume is the score of LightGaussian (Fan et al., 2023).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.rate.curvature import draw
from sacha_core.rate.recolouring import n_views, views_of
from sacha_core.rate.visibility import STOCK_SHARE, Grounds

__all__ = ["COVER", "Seen", "cover_enough", "look_at"]

COVER = 32.0  # fine pixels' weight for each root of a bit's price; 20 is as good on each kind of avatar, 44 too much
FINE_PIXELS = 4  # in one of the other views


@dataclass(frozen=True)
class Seen:
    """What pictures show of n Gaussians.

    Args:
        cover: (n,) how much of the pictures each makes up, pixels of a fine view; small ones, which cost no fewer bits, count less, and
            what only stock expressions show counts a quarter.
        missed: (n,) a quarter of what pictures of stock expressions would change by without it, as `visibility.removal_errors` has it.
    """

    cover: Float[np.ndarray, " n"]
    missed: Float[np.ndarray, " n"]


def look_at(gaussians: Gaussians, grounds: Grounds, rasteriser: Rasteriser | None = None) -> Seen:
    """Measure what pictures show of Gaussians while all are there.

    Args:
        gaussians: n of them.
        grounds: the views.
        rasteriser: one to use again; a new one by default.
    """
    rasteriser = rasteriser or Rasteriser()
    own, elsewhere, missed = (np.zeros(len(gaussians)) for _ in range(3))
    for world, camera in views_of(gaussians, grounds.fine, rasteriser.pool):
        splats = Splats(world.means, world.scales, world.quaternions, world.opacities, gaussians.sh_dc)
        own += rasteriser.cover(splats, camera)
    for world, camera in views_of(gaussians, grounds.stock, rasteriser.pool):
        frame = draw(gaussians, world, camera, rasteriser)
        elsewhere += rasteriser.colour_weights(frame, ones_like(frame))[:, 0]
        missed += rasteriser.removal_changes(frame, ones_like(frame)).squared[:, 0]
    share = STOCK_SHARE / max(n_views(grounds.stock), 1)
    weight = np.maximum(own / max(n_views(grounds.fine), 1), elsewhere * share * FINE_PIXELS)
    with np.errstate(over="ignore"):  # endless ones count as large
        cover = light_gaussian_score(weight, np.exp(gaussians.log_scale.astype(np.float64)))
    return Seen(cover, missed * share)


def ones_like(frame: Frame) -> Float[np.ndarray, "1 h w"]:
    """Give weights of 1 for the pixels of a frame."""
    return np.ones((1, *frame.transmittance.shape), np.float32)


def cover_enough(
    cover: Float[np.ndarray, " n"], price: float, factors: Float[np.ndarray, " n"] | None = None
) -> Int[np.ndarray, " m"]:
    """Give the rows of the Gaussians that make up enough of the pictures for their bits.

    Args:
        cover: (n,) as `look_at` gives it.
        price: squared change of pictures that a bit is worth.
        factors: (n,) how many times as much a squared change by each counts; once by default.
    """
    counted = cover if factors is None else cover * np.sqrt(factors)
    return np.flatnonzero(counted >= COVER * np.sqrt(price))
