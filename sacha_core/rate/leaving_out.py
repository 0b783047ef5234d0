"""Who stays of an avatar at a level: in two steps, the second of which is taken back where it loses more than it saves.

What makes up too little of the pictures goes (`covering`), then what they would hardly miss if it alone were gone (`visibility`). On
avatars with Gaussians to spare that saves some 3 % of the bytes, but where many faint layers make a skin they are worth much more together
than each alone. So it is measured what pictures lose together.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.covering import Seen, cover_enough, look_at
from sacha_core.rate.curvature import draw
from sacha_core.rate.recolouring import Pictures
from sacha_core.rate.visibility import Grounds, prune
from sacha_core.rate.world import in_world

__all__ = ["Leaving"]

ROUNDS = 2  # of the second step: what goes first in more of them is gone already
JOINT_BITS = 20.0  # that Gaussians of the second step may be worth together, each: somewhat less than one costs


@dataclass(frozen=True)
class Leaving:
    """Decides who goes.

    Args:
        gaussians: n of them, the uncompressed avatar's.
        grounds: the views to decide by.
        pictures: of the avatar in its own views.
        seen: of the Gaussians while all are there.
    """

    gaussians: Gaussians
    grounds: Grounds
    pictures: Pictures
    seen: Seen

    @classmethod
    def of(cls, gaussians: Gaussians, grounds: Grounds, pictures: Pictures, rasteriser: Rasteriser) -> Leaving:
        """Measure what the decision needs at every level."""
        return cls(gaussians, grounds, pictures, look_at(gaussians, grounds, rasteriser))

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

        kept = cover_enough(self.seen.cover, price, factors)
        counted = None if factors is None else factors[kept]
        few = self.gaussians.select(kept)
        fewer = kept[prune(few, self.grounds.own, self.seen.missed[kept], bits * price, rasteriser, counted, ROUNDS)]
        if len(fewer) == len(kept):
            return kept
        lost = self.joint_error(fewer, rasteriser) - self.joint_error(kept, rasteriser)
        return fewer if lost <= JOINT_BITS * price * (len(kept) - len(fewer)) else kept

    def joint_error(self, rows: Int[np.ndarray, " m"], rasteriser: Rasteriser) -> float:
        """Give what pictures of some of the Gaussians are off: squared, summed over pixels and channels, mean over one view a pose."""
        left, total = self.gaussians.select(rows), 0.0
        truths = iter(self.pictures.drawn(rasteriser))
        for shot in self.grounds.own:
            first = next(truths)
            off = draw(left, in_world(left, shot.stance, rasteriser.pool), shot.cameras[0], rasteriser).image - first
            total += float(np.vdot(off, off))
            for _ in shot.cameras[1:]:
                next(truths)
        return total / max(len(self.grounds.own), 1)
