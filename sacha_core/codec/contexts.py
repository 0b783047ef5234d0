"""Which context every symbol of a predicted attribute is coded under.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import KINDS, Pass

__all__ = ["ContextPlan"]


@dataclass(frozen=True)
class ContextPlan:
    """The context of every symbol: component, kind of pass, and a class of the Gaussian.

    Args:
        n_components: components of the attribute.
        classes: (n,) class of each Gaussian.
        n_classes: how many there are.
    """

    n_components: int
    classes: Int[np.ndarray, " n"]
    n_classes: int

    @property
    def n_contexts(self) -> int:
        """How many contexts there are."""
        return self.n_components * KINDS * self.n_classes

    def contexts(
        self,
        step: Pass,
        component: int,
        levels: Int[np.ndarray, "n c"],  # noqa: ARG002  # contexts by what was decoded before are to come
    ) -> Int[np.ndarray, " p"]:
        """Context of one component of each Gaussian of a pass.

        Args:
            step: the pass.
            component: which.
            levels: those of earlier passes, and of earlier components of this one.
        """
        return np.asarray((component * KINDS + step.kind) * self.n_classes + self.classes[step.rows])
