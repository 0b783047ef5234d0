"""Who stays of an avatar at a level: in three steps, the last of which is taken back where it loses more than it saves.

What makes up too little of the pictures goes (`covering`), then what a picture would hardly miss (`visibility`), and then what it would
miss somewhat more: on avatars with Gaussians to spare that saves some 3 % of the bytes, but where many faint layers make a skin they are
worth much more together than each alone. So it is measured what pictures lose together.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.covering import cover_enough, covers
from sacha_core.rate.curvature import draw
from sacha_core.rate.recolouring import Pictures
from sacha_core.rate.visibility import Grounds, prune
from sacha_core.rate.world import in_world

__all__ = ["Leaving"]

FIRST = 0.25  # of the bits that a Gaussian has to be worth, in the second step
ROUNDS = 2  # of either step: more change nothing
JOINT_BITS = 30.0  # that Gaussians of the third step may be worth together, each: about what one costs


@dataclass(frozen=True)
class Leaving:
    """Decides who goes.

    Args:
        gaussians: n of them, the uncompressed avatar's.
        grounds: the views to decide by.
        pictures: of the avatar in its own views.
        cover: (n,) as `covering.covers` gives it.
    """

    gaussians: Gaussians
    grounds: Grounds
    pictures: Pictures
    cover: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, gaussians: Gaussians, grounds: Grounds, pictures: Pictures, rasteriser: Rasteriser) -> Leaving:
        """Measure what the decision needs at every level."""
        return cls(gaussians, grounds, pictures, covers(gaussians, grounds, rasteriser))

    def rows(
        self, price: float, bits: float, rasteriser: Rasteriser, factors: Float[np.ndarray, " n"] | None = None
    ) -> Int[np.ndarray, " m"]:
        """Give the rows of the Gaussians that stay.

        Args:
            price: squared change of pictures that a bit is worth.
            bits: that a Gaussian has to be worth, alone; 0 keeps all.
            rasteriser: draws.
            factors: (n,) how many times as much a squared change by each counts; once by default.
        """
        if bits <= 0 or price <= 0:
            return np.arange(len(self.gaussians))

        def without(rows: Int[np.ndarray, " m"], least: float) -> Int[np.ndarray, " k"]:
            counted = None if factors is None else factors[rows]
            return rows[prune(self.gaussians.select(rows), self.grounds, least, rasteriser, counted, ROUNDS)]

        kept = without(cover_enough(self.cover, price, factors), FIRST * bits * price)
        fewer = without(kept, bits * price)
        if len(fewer) == len(kept):
            return kept
        lost = self.joint_error(fewer, rasteriser) - self.joint_error(kept, rasteriser)
        return fewer if lost <= JOINT_BITS * price * (len(kept) - len(fewer)) else kept

    def joint_error(self, rows: Int[np.ndarray, " m"], rasteriser: Rasteriser) -> float:
        """Give what pictures of some of the Gaussians are off: squared, summed over pixels and channels, mean over views."""
        left, total = self.gaussians.select(rows), 0.0
        truths = iter(self.pictures.drawn(rasteriser))
        for shot in self.grounds.own:
            world = in_world(left, shot)
            for camera in shot.cameras:
                off = draw(left, world, camera, rasteriser).image - next(truths)
                total += float(np.vdot(off, off))
        return total / max(sum(len(shot.cameras) for shot in self.grounds.own), 1)
