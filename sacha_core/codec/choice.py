r"""Which level each difference gets: the encoder's own business.

Of the nearest level, the one below it and zero, that of the least $w (r / s - l)^2 + \lambda b(l)$ is taken: r the difference, s its step,
w what its Gaussian is worth against what the step was made for, b(l) the bits of the level in its context.

Source: rate-distortion optimised quantisation, as in video encoders (Karczewicz et al., 2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.grouping import LevelBits

__all__ = ["PLAIN", "Chooser", "Worth"]


@dataclass(frozen=True)
class Worth:
    """What errors and bits are worth.

    Args:
        lagrangian: squared steps for a bit. 0: always the nearest level. A uniform quantiser at a high rate trades 0.1155.
        weights: (n, c) worth of a squared step of each component of each Gaussian, about 1; None stands for 1.
    """

    lagrangian: float = 0.0
    weights: Float[np.ndarray, "n c"] | None = None

    def of(self, component: int) -> Worth:
        """Give that of one component alone."""
        return self if self.weights is None else Worth(self.lagrangian, self.weights[:, component : component + 1])


PLAIN = Worth()


@dataclass(frozen=True)
class Chooser:
    """Chooses levels.

    Args:
        worth: of errors and bits.
        bits: of each level in each context; None takes the nearest level.
    """

    worth: Worth = PLAIN
    bits: LevelBits | None = None

    def choose(
        self,
        rows: Int[np.ndarray, " p"],
        component: int,
        residual: Int[np.ndarray, " p"],
        steps: Int[np.ndarray, " p"],
        contexts: Int[np.ndarray, " p"],
    ) -> Int[np.ndarray, " p"]:
        """Give the levels of a component of Gaussians at `rows`."""
        exact = residual / steps
        nearest = np.rint(exact).astype(np.int64)
        if self.bits is None or self.worth.lagrangian == 0:
            return np.asarray(nearest)
        weight = 1.0 if self.worth.weights is None else self.worth.weights[rows, component]
        best, least = nearest, np.inf
        for level in (nearest, nearest - np.sign(nearest), np.zeros_like(nearest)):
            cost = weight * np.square(exact - level) + self.worth.lagrangian * self.bits.of(level, contexts)
            best, least = np.where(cost < least, level, best), np.minimum(cost, least)
        return np.asarray(best)
