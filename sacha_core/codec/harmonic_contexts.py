r"""Contexts of harmonics' levels: how large each is likely to be, from those of neighbours and of mates.

The size of a level is estimated as a floor for its component plus known sizes by weights, all sent; its class in half octaves, and how
transparent the Gaussian is, make the context. Components of all functions share these contexts: sections are small, and tables cost bytes.
Other components of the same Gaussian hardly tell more (1 % at most), so that all of a pass are coded at once.

Source: own; estimates as in the lossless image coder TMW (Meyer and Tischer, 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.order import MATES, Pass
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import STEPS, Classes, StepRule

__all__ = ["FEATURES", "GROUPS", "N_CONTEXTS", "ONE", "Activity", "ActivityPlan", "scale_of"]

GROUPS = 2  # weights of firsts, and of mates
FEATURES = 2  # sizes of neighbours, of mates
ONE = 1 << 12  # a level of 1, in estimates
ESTIMATE_SHIFT = 2  # from 64ths by 256ths to that
FIRST_BOUND, SIZE_CLASSES = 20, 24
BOUNDS = STEPS[FIRST_BOUND : FIRST_BOUND + 4 * (SIZE_CLASSES - 1) : 4]  # half octaves
CLASS_OF = np.searchsorted(BOUNDS, np.arange(BOUNDS[-1] + 1), side="right")  # of each estimate up to the last bound
TRANSPARENCIES = 4
N_CONTEXTS = SIZE_CLASSES * TRANSPARENCIES
FINE, WIDEST = 64, 127  # exponents of scales: where a rule is at its lowest, and at most above it
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
    """Follows the passes and gives contexts.

    Args:
        plan: how sizes are estimated.
        rule: of the steps.
        classes: what steps depend on.
    """

    def __init__(self, plan: ActivityPlan, rule: StepRule, classes: Classes) -> None:
        self._plan = plan
        self._floors = STEPS[plan.floors]
        self._scale = scale_of(rule, classes)
        self._glass = np.minimum(classes.transparency, TRANSPARENCIES - 1) * SIZE_CLASSES
        self._sizes = np.zeros((len(self._scale), len(plan.floors)), np.int64)

    def contexts(self, step: Pass) -> Int[np.ndarray, "p c"]:
        """Context of every component of each Gaussian of a pass."""
        rows = step.rows
        compiled = compiled_loops("contexts", len(self._sizes))
        if compiled:
            classes = np.empty((len(rows), len(self._floors)), np.int64)
            compiled.classes_of_activity(
                self._sizes, rows, step.near, step.trust, step.mates, np.ascontiguousarray(step.mate_trust),
                self._plan.weights[int(step.kind == MATES)], self._floors, self._scale, self._glass, ESTIMATE_SHIFT, CLASS_OF, classes
            )  # fmt: skip
            return classes
        known = np.zeros((len(rows), len(self._floors)), np.int64)
        weights = self._plan.weights[int(step.kind == MATES)]
        for weight, others, trust in zip(weights, (step.near, step.mates), (step.trust, step.mate_trust), strict=True):
            if weight and trust.any():
                for column in range(others.shape[1]):
                    known += self._sizes[others[:, column]] * (weight * trust[:, column, None])
        estimate = self._floors + ((known // self._scale[rows, None]) >> ESTIMATE_SHIFT)
        return np.asarray(CLASS_OF[np.minimum(estimate, BOUNDS[-1])] + self._glass[rows, None])

    def learn(self, step: Pass, levels: Int[np.ndarray, "p c"]) -> None:
        """Take in the levels of a pass."""
        self._sizes[step.rows] = np.minimum(np.abs(levels) * self._scale[step.rows, None], MOST)
