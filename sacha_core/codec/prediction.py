r"""What the values of a pass are expected to be: a mixture of the means of neighbours and of mates around a centre.

With N and M the means of what is known nearby and in the same triangle, expected is
$c + (w_N (N - c) + w_M (M - c) + 32) / 64$, rounded down. The weights are fitted by least squares for each kind of pass and
component, and sent in 64ths.

Source: own.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.order import KINDS, Layout, Pass, weighted_mean
from sacha_core.codec.reading import ByteReader

__all__ = ["LIMIT", "Linear", "Mixture", "Prediction", "fit_mixture"]

LIMIT = 1 << 40  # no attribute comes near; a decoder stops before sums could leave 64 bits
TERMS = 2  # neighbours, mates
WEIGHT_BITS = 6
MAX_WEIGHT = 127


class Prediction(Protocol):
    """What is known of an attribute, pass by pass."""

    def enter(self, step: Pass) -> None:
        """Begin a pass: form what its values are expected to be."""

    def residual(self) -> Int[np.ndarray, "p c"]:
        """Give how far off the values of the pass are, in fine units: for encoders, which know them."""

    def learn(self, difference: Int[np.ndarray, "p c"]) -> None:
        """Take in the decoded differences of the pass."""


@dataclass(frozen=True)
class Mixture:
    """A linear predictor.

    Args:
        centre: (c,) what is expected of a Gaussian of which nothing is known.
        weights: (KINDS, TERMS, c) trust in neighbours and in mates, in 64ths.
    """

    centre: Int[np.ndarray, " c"]
    weights: Int[np.ndarray, "k t c"]

    def predict(self, step: Pass, values: Int[np.ndarray, "n c"]) -> Int[np.ndarray, "p c"]:
        """Expected values of a pass, from the values known before it."""
        total = np.full((len(step.rows), len(self.centre)), 1 << (WEIGHT_BITS - 1), np.int64)
        for term, away in enumerate(terms_of(step, values, self.centre)):
            total += away * self.weights[step.kind, term]
        return np.asarray(self.centre + (total >> WEIGHT_BITS))

    def pack(self) -> bytes:
        """Write centre and weights."""
        return struct.pack(f"<{len(self.centre)}q", *self.centre) + self.weights.astype(np.int8).tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader, n_components: int) -> Mixture:
        """Read what `pack` wrote.

        Raises:
            FormatError: a centre is out of range.
        """
        centre = np.array(reader.unpack(f"{n_components}q"), np.int64)
        if np.abs(centre.astype(np.float64)).max(initial=0) > LIMIT:
            raise reader.error(f"a centre is beyond +-{LIMIT} units")
        shape = (KINDS, TERMS, n_components)
        weights = np.frombuffer(reader.take(int(np.prod(shape))), np.int8).reshape(shape)
        return cls(centre, weights.astype(np.int64))


class Linear:
    """Integers that a mixture predicts.

    Args:
        mixture: of neighbours, mates and centre.
        targets: (n, c) what an encoder is to code; a decoder gives zeros.
    """

    def __init__(self, mixture: Mixture, targets: Int[np.ndarray, "n c"]) -> None:
        self._mixture = mixture
        self._targets = targets
        self.values = np.zeros(targets.shape, np.int64)

    def enter(self, step: Pass) -> None:
        """Begin a pass."""
        self._rows = step.rows
        self._expected = self._mixture.predict(step, self.values)

    def residual(self) -> Int[np.ndarray, "p c"]:
        """Give target less expected value."""
        return np.asarray(self._targets[self._rows] - self._expected)

    def learn(self, difference: Int[np.ndarray, "p c"]) -> None:
        """Add differences to what was expected."""
        self.values[self._rows] = self._expected + difference


def terms_of(
    step: Pass, values: Int[np.ndarray, "n c"], centre: Int[np.ndarray, " c"]
) -> Iterator[Int[np.ndarray, "p c"]]:
    """Means of neighbours and of mates less the centre; 0 where there are none."""
    for rows, trust in ((step.near, step.trust), (step.mates, step.mate_trust)):
        there = trust.sum(axis=1, keepdims=True) > 0
        yield np.where(there, weighted_mean(values, rows, trust) - centre, 0)


def fit_mixture(layout: Layout, values: Int[np.ndarray, "n c"]) -> Mixture:
    """Least-squares weights for each kind of pass and component, from the values before quantisation."""
    n_components = values.shape[1]
    centre = np.median(values, axis=0).astype(np.int64) if len(values) else np.zeros(n_components, np.int64)
    normal = np.zeros((KINDS, n_components, TERMS, TERMS))
    right = np.zeros((KINDS, n_components, TERMS))
    for step in layout.passes:
        terms = np.stack(list(terms_of(step, values, centre)), axis=-1).astype(np.float64)
        normal[step.kind] += np.einsum("pct,pcu->ctu", terms, terms)
        right[step.kind] += np.einsum("pct,pc->ct", terms, values[step.rows] - centre)
    return Mixture(centre, np.moveaxis(solve(normal, right), 1, 2))


def solve(normal: Float[np.ndarray, "k c t t"], right: Float[np.ndarray, "k c t"]) -> Int[np.ndarray, "k c t"]:
    """Weights in 64ths; the smallest where the sums do not tell them."""
    weights = np.einsum("kctu,kcu->kct", np.linalg.pinv(normal, hermitian=True), right)
    sent = np.clip(np.rint(weights * (1 << WEIGHT_BITS)), -MAX_WEIGHT, MAX_WEIGHT)
    return np.asarray(sent.astype(np.int64))
