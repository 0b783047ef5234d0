r"""Section `Harmonic`: spherical-harmonics coefficients of degree 1 and up, in few components that pictures can tell apart.

A capture sees a head from the front, and there most combinations of coefficients look alike. So the encoder sends a basis: one of colours
(three axes) and one of coefficients, in whose components errors show as much as they are large and values are few; what it is made for
is the encoder's business (`harmonic_basis`). Components are predicted from neighbours and mates, as all attributes are, and quantised by
one rule with an exponent of its own for each function of the basis.

Source: own; Karhunen and Loeve's transform under the metric of the pictures' error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.harmonic_contexts import N_CONTEXTS, Activity, ActivityPlan
from sacha_core.codec.order import MATES, Layout, Pass, weighted_mean
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, STEPS, Classes, StepRule
from sacha_core.codec.symbols import SymbolReader

__all__ = ["BASIS_ONE", "LIMIT", "UNIT", "Neighbourhood", "Transform", "decode_harmonics"]

UNIT = 2.0**-14  # of a component
BASIS_ONE = 128  # a one in the bases
RESULT_UNIT = UNIT / BASIS_ONE**2
LIMIT = 1 << 32  # of a component, in `UNIT`: sums of 45 products stay exact in float64
AXES = 3
GROUPS = 2  # firsts, mates
TERMS = 2  # neighbours, mates
WEIGHT_BITS = 6
AT_ONCE = 2048  # rows whose coefficients stay in a processor's cache


@dataclass(frozen=True)
class Transform:
    """What components mean and how coarse they are.

    Args:
        rule: exponent of the step of each Gaussian.
        counts: for each axis of colours how many functions it uses.
        axes: (3, 3) red, green and blue of each axis of colours, in 128ths.
        basis: (f, k) coefficients of each function, in 128ths; f is the largest of `counts`.
        exponents: (f,) added to the rule's for each function.
    """

    rule: StepRule
    counts: tuple[int, ...]
    axes: Int[np.ndarray, "3 3"]
    basis: Int[np.ndarray, "f k"]
    exponents: Int[np.ndarray, " f"]

    @cached_property
    def components(self) -> tuple[tuple[int, int], ...]:
        """Function and axis of each component, in coding order."""
        return tuple((f, a) for f in range(len(self.basis)) for a in range(AXES) if f < self.counts[a])

    @cached_property
    def functions(self) -> Int[np.ndarray, " c"]:
        """Function of each component."""
        return np.array([f for f, _ in self.components], np.int64)

    @cached_property
    def axis(self) -> Int[np.ndarray, " c"]:
        """Axis of colours of each component."""
        return np.array([a for _, a in self.components], np.int64)

    def steps(self, classes: Classes) -> Int[np.ndarray, "n c"]:
        """Step of every component of every Gaussian."""
        exponents = self.rule.base + self.rule.shift(classes)
        return np.asarray(STEPS[exponents[:, None] + self.exponents[self.functions]])

    def activity(self, plan: ActivityPlan, classes: Classes) -> Activity:
        """Contexts of the levels, before the first pass."""
        return Activity(plan, self.rule, classes)

    def coefficients(self, values: Int[np.ndarray, "n c"]) -> Float[np.ndarray, "n k 3"]:
        """Give float32 coefficients of components. Sums of integers below 2^53: exact in float64, in whatever order they are summed."""
        rows = self.basis[self.functions][:, :, None] * self.axes[self.axis][:, None, :]
        wide = rows.reshape(len(rows), self.basis.shape[1] * AXES).astype(np.float64)
        rest = np.empty((len(values), wide.shape[1]), np.float32)
        for start in range(0, len(values), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            rest[some] = (values[some].astype(np.float64) @ wide) * RESULT_UNIT
        return rest.reshape(len(values), self.basis.shape[1], AXES)

    def pack(self) -> bytes:
        """Write everything."""
        numbers = np.concatenate([self.axes.ravel(), self.basis.ravel(), self.exponents])
        return self.rule.pack() + bytes(self.counts) + numbers.astype(np.int8).tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader, n_harmonics: int) -> Transform:
        """Read what `pack` wrote.

        Raises:
            FormatError: there are more functions than coefficients, or steps leave their table.
        """
        rule = StepRule.unpack(reader)
        counts = reader.unpack(f"{AXES}B")
        if max(counts) > n_harmonics:
            raise reader.error(f"{max(counts)} functions make {n_harmonics} coefficients")
        axes = signed(reader, AXES * AXES).reshape(AXES, AXES)
        basis = signed(reader, max(counts) * n_harmonics).reshape(max(counts), n_harmonics)
        exponents = signed(reader, max(counts))
        least, most = exponents.min(initial=0) + rule.base + rule.low, exponents.max(initial=0) + rule.base + rule.most
        if least < 0 or most > MAX_EXPONENT:
            raise reader.error(f"steps reach from {least} to {most}, table is 0 to {MAX_EXPONENT}")
        return cls(rule, counts, axes, basis, exponents)


def signed(reader: ByteReader, count: int) -> Int[np.ndarray, " m"]:
    """Read so many signed bytes."""
    return np.frombuffer(reader.take(count), np.int8).astype(np.int64)


@dataclass(frozen=True)
class Neighbourhood:
    """How far neighbours and mates are followed.

    Args:
        weights: (GROUPS, TERMS, c) of their means, in 64ths.
    """

    weights: Int[np.ndarray, "g t c"]

    def predict(self, step: Pass, values: Int[np.ndarray, "n c"]) -> Int[np.ndarray, "p c"]:
        """Expected components of a pass, from those known before it."""
        near, mates = self.weights[int(step.kind == MATES)]
        total = weighted_mean(values, step.near, step.trust) * near
        if mates.any() and step.mate_trust.any():
            total = total + weighted_mean(values, step.mates, step.mate_trust) * mates
        return np.asarray((total + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS)

    def pack(self) -> bytes:
        """Write the weights."""
        return self.weights.astype(np.int8).tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader, n_components: int) -> Neighbourhood:
        """Read what `pack` wrote."""
        return cls(signed(reader, GROUPS * TERMS * n_components).reshape(GROUPS, TERMS, n_components))


def decode_harmonics(
    reader: ByteReader, layout: Layout, n_harmonics: int, classes: Classes
) -> Float[np.ndarray, "n k 3"]:
    """Read coefficients.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    transform = Transform.unpack(reader, n_harmonics)
    n_components = len(transform.components)
    neighbourhood = Neighbourhood.unpack(reader, n_components)
    activity = transform.activity(ActivityPlan.unpack(reader, n_components), classes)
    steps = transform.steps(classes)
    symbols = SymbolReader(reader, N_CONTEXTS)
    values = np.zeros(steps.shape, np.int64)
    for step in layout.passes:
        levels = symbols.read(activity.contexts(step))
        activity.learn(step, levels)
        found = neighbourhood.predict(step, values) + levels * steps[step.rows]
        if np.abs(found).max(initial=0) > LIMIT:
            raise reader.error(f"a component is beyond +-{LIMIT} units")
        values[step.rows] = found
    symbols.check_end()
    return transform.coefficients(values)
