r"""Contexts of harmonics' levels: how large each is likely to be, from those of neighbours, of mates and of the same Gaussian.

The size of a level is estimated as a floor for its component plus known sizes by weights, all sent; its class in half octaves, and how
transparent the Gaussian is, make the context. Components of all functions share these contexts: sections are small, and tables cost bytes.

Source: own; estimates as in the lossless image coder TMW (Meyer and Tischer, 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import MATES, Pass
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import STEPS, Classes, StepRule

__all__ = ["FEATURES", "GROUPS", "N_CONTEXTS", "ONE", "Activity", "ActivityPlan", "scale_of"]

GROUPS = 2  # weights of firsts, and of mates
FEATURES = (
    4  # sizes of neighbours, of mates; of earlier functions on the same axis; of the same function on axes before
)
ONE = 1 << 12  # a level of 1, in estimates
ESTIMATE_SHIFT = 2  # from 64ths by 256ths to that
FIRST_BOUND, SIZE_CLASSES = 20, 24
BOUNDS = STEPS[FIRST_BOUND : FIRST_BOUND + 4 * (SIZE_CLASSES - 1) : 4]  # half octaves
TRANSPARENCIES = 4
N_CONTEXTS = SIZE_CLASSES * TRANSPARENCIES
FINE, WIDEST = (
    64,
    127,
)  # exponents: of the step that sizes are measured by where a rule is at its lowest, and at most above it
MOST = 1 << 28  # sizes stay below, so that sums stay within 64 bits


@dataclass(frozen=True)
class ActivityPlan:
    """How sizes are estimated.

    Args:
        weights: (GROUPS, FEATURES) of known sizes, in 256ths, 0 to 255.
        floors: (c,) exponents of `STEPS`: what every estimate of a component begins with, in 4096ths of a level.
    """

    weights: Int[np.ndarray, "g w"]
    floors: Int[np.ndarray, " c"]

    def pack(self) -> bytes:
        """Write all numbers."""
        return np.concatenate([self.weights.ravel(), self.floors]).astype(np.uint8).tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader, n_components: int) -> ActivityPlan:
        """Read what `pack` wrote.

        Raises:
            FormatError: a floor is outside the table of steps.
        """
        numbers = np.frombuffer(reader.take(GROUPS * FEATURES + n_components), np.uint8).astype(np.int64)
        weights, floors = numbers[: GROUPS * FEATURES], numbers[GROUPS * FEATURES :]
        if floors.max(initial=0) >= len(STEPS):
            raise reader.error(f"a floor of exponent {floors.max()}, table is 0 to {len(STEPS) - 1}")
        return cls(weights.reshape(GROUPS, FEATURES), floors)


def scale_of(rule: StepRule, classes: Classes) -> Int[np.ndarray, " n"]:
    """Size of each Gaussian's step, so that sizes of levels compare."""
    return np.asarray(STEPS[FINE + np.minimum(rule.shift(classes) - rule.low, WIDEST)])


class Activity:
    """Follows the passes and gives contexts, one component after the other.

    Args:
        plan: how sizes are estimated.
        functions: (c,) function of each component, in coding order.
        axis: (c,) its axis of colours.
        rule: of the steps.
        classes: what steps depend on.
    """

    def __init__(
        self,
        plan: ActivityPlan,
        functions: Int[np.ndarray, " c"],
        axis: Int[np.ndarray, " c"],
        rule: StepRule,
        classes: Classes,
    ) -> None:
        self._plan = plan
        self._floors = STEPS[plan.floors]
        self._new = np.diff(functions, prepend=-1) != 0
        self._axis = axis
        self._scale = scale_of(rule, classes)
        self._glass = np.minimum(classes.transparency, TRANSPARENCIES - 1) * SIZE_CLASSES
        self._sizes = np.zeros((len(self._scale), len(axis)), np.int64)

    def enter(self, step: Pass) -> None:
        """Begin a pass."""
        self._rows = step.rows
        self._own_scale = self._scale[step.rows]
        weights = self._plan.weights[int(step.kind == MATES)]
        self._own_weights = weights[2:]
        known = np.zeros((len(step.rows), len(self._axis)), np.int64)
        for weight, rows, trust in ((weights[0], step.near, step.trust), (weights[1], step.mates, step.mate_trust)):
            if weight and trust.any():
                for column in range(rows.shape[1]):
                    known += self._sizes[rows[:, column]] * (weight * trust[:, column, None])
        self._known = known
        self.restart()

    def restart(self) -> None:
        """Begin the components of the pass again."""
        self._spent = np.zeros((int(self._axis.max(initial=0)) + 1, len(self._rows)), np.int64)
        self._beside = np.zeros(len(self._rows), np.int64)

    def features(self, component: int) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
        """Sizes of earlier functions on the component's axis, and of its function on axes before."""
        if self._new[component]:
            self._beside = np.zeros_like(self._beside)
        return self._spent[self._axis[component]], self._beside

    def contexts(self, component: int) -> Int[np.ndarray, " p"]:
        """Context of a component of each Gaussian of the pass; components are asked for in turn."""
        earlier, beside = self.features(component)
        sizes = self._known[:, component] + ((earlier * self._own_weights[0] + beside * self._own_weights[1]) << 6)
        estimate = self._floors[component] + ((sizes // self._own_scale) >> ESTIMATE_SHIFT)
        return np.asarray(np.searchsorted(BOUNDS, estimate, side="right") + self._glass[self._rows])

    def learn(self, component: int, levels: Int[np.ndarray, " p"]) -> None:
        """Take in the levels of a component of the pass."""
        sizes = np.minimum(np.abs(levels) * self._own_scale, MOST)
        self._sizes[self._rows, component] = sizes
        self._spent[self._axis[component]] += sizes
        self._beside = self._beside + sizes
