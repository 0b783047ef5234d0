r"""Contexts of levels: how large each is likely to be, estimated from those coded before it.

Where neighbours and mates were predicted badly the next Gaussian will be, and a Gaussian one of whose components was a surprise has
more to come. So the size of a difference is estimated as a sum of known ones by weights that the encoder fits and sends, in units of
the difference's own step, and its context is the half octave of that estimate. Integer arithmetic, the same on every machine.

Source: own; as in the lossless image coders TMW (Meyer and Tischer, 1997) and MRP (Matsuda et al., 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.order import KINDS, MATES, Pass, weighted_mean
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, STEPS

__all__ = ["FEATURES", "GROUPS", "MAX_WEIGHT", "PER_STEP", "SIZE_CLASSES", "WEIGHT_BITS", "ContextPlan", "Sizes"]

GROUPS = 2  # weights of firsts, and of mates
FEATURES = 4  # sizes of neighbours and of mates, of the component itself and of all; then those of earlier components
WEIGHT_BITS = 6
MAX_WEIGHT = 255
PER_STEP = 16  # estimates are in sixteenths of a step
BOUNDS = np.array([math.isqrt(1 << k) for k in range(2, 23)], np.int64)  # of the classes: an eighth to 128 steps
SIZE_CLASSES = len(BOUNDS) + 1
CLASS_OF = np.searchsorted(BOUNDS, np.arange(BOUNDS[-1] + 1), side="right")  # of each estimate up to the last bound
MOST = 1 << 40  # fine units; sums of sizes stay within 64 bits
PLAN_CONTEXTS = 3


@dataclass(frozen=True)
class ContextPlan:
    """How sizes are estimated.

    Args:
        weights: (c, GROUPS, FEATURES + c - 1) of known sizes, in 64ths, 0 to 255.
        floors: (c, GROUPS) exponents of `STEPS`: a size in fine units that is always added.
        offsets: (c, KINDS) sixteenths of a step that are always added, 0 to 255.
    """

    weights: Int[np.ndarray, "c g w"]
    floors: Int[np.ndarray, "c g"]
    offsets: Int[np.ndarray, "c k"]

    def pack(self) -> bytes:
        """Write all numbers, many of which are 0, as adaptive integers."""
        coder = AdaptiveEncoder(PLAN_CONTEXTS)
        for context, numbers in enumerate((self.weights, self.floors, self.offsets)):
            coder.write(numbers.reshape(-1), np.full(numbers.size, context))
        coded = coder.finish()
        return bytes([len(coded)]) + coded

    @classmethod
    def unpack(cls, reader: ByteReader, n_components: int) -> ContextPlan:
        """Read what `pack` wrote.

        Raises:
            FormatError: a number is out of range.
        """
        (n_bytes,) = reader.unpack("B")
        offset = reader.offset
        coder = AdaptiveDecoder(reader.take(n_bytes), PLAN_CONTEXTS, offset=offset)
        shapes = ((GROUPS, FEATURES + n_components - 1), (GROUPS,), (KINDS,))
        arrays = []
        for context, (shape, most) in enumerate(zip(shapes, (MAX_WEIGHT, MAX_EXPONENT, MAX_WEIGHT), strict=True)):
            count = n_components * math.prod(shape)
            numbers = coder.read(np.full(count, context))
            if numbers.min(initial=0) < 0 or numbers.max(initial=0) > most:
                raise reader.error(f"a number of the contexts lies outside 0 to {most}")
            arrays.append(numbers.reshape(n_components, *shape))
        coder.check_end()
        return cls(*arrays)


class Sizes:
    """Sizes of the differences coded so far, in fine units, and the contexts that follow from them.

    Args:
        steps: (n, c) quantiser steps.
    """

    def __init__(self, steps: Int[np.ndarray, "n c"]) -> None:
        self._steps = np.array(steps)
        self._known = np.zeros(steps.shape, np.int64)
        self._compiled = compiled_loops("contexts", len(steps))

    def enter(self, step: Pass) -> None:
        """Begin a pass."""
        near = weighted_mean(self._known, step.near, step.trust)
        mates = weighted_mean(self._known, step.mates, step.mate_trust)
        self._around = near, mates
        self._all: tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]] | None = None
        self._pass = step

    def features(self, component: int) -> list[Int[np.ndarray, " p"]]:
        """What the size of a component of each Gaussian of the pass is estimated from."""
        near, mates = self._around
        if self._all is None:  # compiled loops add up themselves
            self._all = near.sum(axis=1), mates.sum(axis=1)
        near_all, mates_all = self._all
        earlier = [self._known[self._pass.rows, before] for before in range(component)]
        return [near[:, component], near_all, mates[:, component], mates_all, *earlier]

    def contexts(self, plan: ContextPlan, component: int) -> Int[np.ndarray, " p"]:
        """Context of a component of each Gaussian of the pass: the class of its estimated size."""
        rows, kind = self._pass.rows, self._pass.kind
        group = int(kind == MATES)
        if self._compiled:
            classes = np.empty(len(rows), np.int64)
            trust = plan.weights[component, group]
            floor, offset = STEPS[plan.floors[component, group]], plan.offsets[component, kind]
            self._compiled.classes_of_sizes(
                self._known, rows, self._steps, *self._around, trust, component, floor, offset, PER_STEP, WEIGHT_BITS, CLASS_OF, classes
            )  # fmt: skip
            return classes
        total = np.zeros(len(rows), np.int64)
        for weight, feature in zip(plan.weights[component, group].tolist(), self.features(component), strict=False):
            if weight:
                total += weight * feature
        size = (total >> WEIGHT_BITS) + STEPS[plan.floors[component, group]]
        estimate = size * PER_STEP // self._steps[rows, component] + plan.offsets[component, kind]
        return np.asarray(CLASS_OF[np.minimum(estimate, BOUNDS[-1])])

    def learn(self, component: int, levels: Int[np.ndarray, " p"]) -> None:
        """Take in the levels of a component of the pass."""
        rows = self._pass.rows
        if self._compiled:
            self._compiled.learn_sizes(self._known, rows, self._steps, levels, component, MOST)
            return
        self._known[rows, component] = np.minimum(np.abs(levels) * self._steps[rows, component], MOST)
