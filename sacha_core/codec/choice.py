"""Which level each residual gets: the encoder's own business.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import Pass
from sacha_core.codec.steps import quantise

__all__ = ["Nearest"]


@dataclass(frozen=True)
class Nearest:
    """Takes the nearest level, but zero for a little more than half a step.

    Args:
        dead_zone: how much further than half a step a residual may be and still become zero.
    """

    dead_zone: float = 0.0

    def choose(
        self,
        step: Pass,  # noqa: ARG002  # other choosers weigh Gaussians, components and the bits of a context
        component: int,  # noqa: ARG002
        residual: Int[np.ndarray, " p"],
        steps: Int[np.ndarray, " p"],
        contexts: Int[np.ndarray, " p"],  # noqa: ARG002
    ) -> Int[np.ndarray, " p"]:
        """Give the levels of one component of a pass."""
        return quantise(residual, steps, self.dead_zone)
