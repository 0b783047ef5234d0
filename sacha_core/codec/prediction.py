r"""What the values of a pass are expected to be: a mixture of the means of neighbours and of mates around a centre.

With N and M the means of what is known nearby and in the same triangle, expected is $c + (w_N (N - c) + w_M (M - c) + 32) / 64$, rounded
down; and to that of a component come the differences that earlier components of the same Gaussian turned out to have, by weights of their
own. Weights are sent in 64ths. An encoder fits them for each kind of pass and component to make the differences small in steps.

Source: own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.order import KINDS, Layout, Pass, trusted, weighted_mean
from sacha_core.codec.places import TRUST_BITS
from sacha_core.codec.reading import ByteReader

__all__ = ["LIMIT", "WEIGHT_BITS", "Linear", "Mixture", "Prediction", "fit_mixture", "lists_of"]

LIMIT = 1 << 40  # no attribute comes near; a decoder stops before sums could leave 64 bits
TERMS = 2  # neighbours, mates
WEIGHT_BITS = 6
MAX_WEIGHT = 127
N_FITS = 5
MOST_ROWS = 6000  # that a fit looks at: more do not change what is found


class Prediction(Protocol):
    """What is known of an attribute, pass by pass."""

    def enter(self, step: Pass) -> None:
        """Begin a pass: form what its values are expected to be."""

    def residual(self, component: int) -> Int[np.ndarray, " p"]:
        """Give how far off a component of the pass is, in fine units: for encoders, which know it."""

    def learn(self, component: int, difference: Int[np.ndarray, " p"]) -> None:
        """Take in the decoded differences of a component of the pass, in their order."""


@dataclass(frozen=True)
class Mixture:
    """A linear predictor.

    Args:
        centre: (c,) what is expected of a Gaussian of which nothing is known.
        weights: (KINDS, TERMS, c) trust in neighbours and in mates, in 64ths.
        across: (c, c) trust of each component (row) in what earlier ones are off, in 64ths; 0 from the diagonal on.
    """

    centre: Int[np.ndarray, " c"]
    weights: Int[np.ndarray, "k t c"]
    across: Int[np.ndarray, "c c"]

    def predict(self, step: Pass, values: Int[np.ndarray, "n c"]) -> Int[np.ndarray, "p c"]:
        """Expected values of a pass, from the values known before it."""
        compiled = compiled_loops("prediction", len(values))
        if compiled:
            there = np.array([trusted(trust) for _, trust in lists_of(step)])
            weights = self.weights[step.kind] * there[:, None]
            out = np.empty((len(step.rows), len(self.centre)), np.int64)
            mate_trust = np.ascontiguousarray(step.mate_trust)
            compiled.predict_values(
                values,
                step.near,
                step.trust,
                step.mates,
                mate_trust,
                self.centre,
                weights,
                TRUST_BITS,
                WEIGHT_BITS,
                out,
            )
            return out
        total = np.full((len(step.rows), len(self.centre)), 1 << (WEIGHT_BITS - 1), np.int64)
        for weights, (rows, trust) in zip(self.weights[step.kind], lists_of(step), strict=True):
            if weights.any() and trusted(trust):
                total += (weighted_mean(values, rows, trust) - self.centre) * weights
        return np.asarray(self.centre + (total >> WEIGHT_BITS))

    def pack(self) -> bytes:
        """Write centre and weights."""
        below = self.across[np.tril_indices(len(self.across), -1)]
        weights = np.concatenate([self.weights.reshape(-1), below]).astype(np.int8)
        return struct.pack(f"<{len(self.centre)}q", *self.centre) + weights.tobytes()

    @classmethod
    def unpack(cls, reader: ByteReader, n_components: int) -> Mixture:
        """Read what `pack` wrote.

        Raises:
            FormatError: a centre is out of range.
        """
        centre = np.array(reader.unpack(f"{n_components}q"), np.int64)
        if np.abs(centre.astype(np.float64)).max(initial=0) > LIMIT:
            raise reader.error(f"a centre is beyond +-{LIMIT} units")
        shape, below = (KINDS, TERMS, n_components), np.tril_indices(n_components, -1)
        sent = reader.take(int(np.prod(shape)) + len(below[0]))
        numbers = np.frombuffer(sent, np.int8).astype(np.int64)
        across = np.zeros((n_components, n_components), np.int64)
        across[below] = numbers[int(np.prod(shape)) :]
        return cls(centre, numbers[: int(np.prod(shape))].reshape(shape), across)


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
        self._off = np.zeros_like(self._expected)

    def expected(self, component: int) -> Int[np.ndarray, " p"]:
        """Give what a component is expected to be, from neighbours, mates and earlier components."""
        across = self._mixture.across[component]
        if not across.any():
            return np.asarray(self._expected[:, component])
        total = np.full(len(self._rows), 1 << (WEIGHT_BITS - 1), np.int64)
        for before in range(component):
            total += self._off[:, before] * across[before]
        return np.asarray(self._expected[:, component] + (total >> WEIGHT_BITS))

    def residual(self, component: int) -> Int[np.ndarray, " p"]:
        """Give target less expected value."""
        return np.asarray(self._targets[self._rows, component] - self.expected(component))

    def learn(self, component: int, difference: Int[np.ndarray, " p"]) -> None:
        """Add differences to what was expected."""
        compiled = compiled_loops("prediction", len(self.values))
        if compiled:
            across = self._mixture.across[component]
            compiled.learn_values(
                self.values, self._rows, self._expected, self._off, across, component, difference, WEIGHT_BITS
            )
            return
        value = self.expected(component) + difference
        self._off[:, component] = value - self._expected[:, component]
        self.values[self._rows, component] = value


def lists_of(step: Pass) -> tuple[tuple[Int[np.ndarray, "p k"], Int[np.ndarray, "p k"]], ...]:
    """Neighbours and mates, with the trust in them: one for each term."""
    return (step.near, step.trust), (step.mates, step.mate_trust)


def fit_mixture(layout: Layout, values: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n c"]) -> Mixture:
    """Fit all weights to the values before quantisation."""
    n, n_components = values.shape
    centre = np.median(values, axis=0).astype(np.int64) if n else np.zeros(n_components, np.int64)
    terms, kinds = np.zeros((n, n_components, TERMS)), np.zeros(n, np.int64)
    for step in layout.passes:
        kinds[step.rows] = step.kind
        for term, (rows, trust) in enumerate(lists_of(step)):
            if trusted(trust):
                terms[step.rows, :, term] = weighted_mean(values, rows, trust) - centre
    weights = np.zeros((KINDS, TERMS, n_components), np.int64)
    across = np.zeros((n_components, n_components), np.int64)
    off = (values - centre).astype(np.float64)
    for component in range(n_components):
        for kind in range(KINDS):
            rows = kinds == kind
            weights[kind, :, component] = fit_weights(
                terms[rows, component], off[rows, component], steps[rows, component]
            )
        off[:, component] -= (terms[:, component] * weights[kinds, :, component]).sum(axis=1) / (1 << WEIGHT_BITS)
        across[component, :component] = fit_weights(off[:, :component], off[:, component], steps[:, component])
    return Mixture(centre, weights, across)


def fit_weights(
    terms: Float[np.ndarray, "p t"], target: Float[np.ndarray, " p"], steps: Int[np.ndarray, " p"]
) -> Int[np.ndarray, " t"]:
    """Weights in 64ths that leave the least sum of magnitudes in steps, by least squares weighted anew; the smallest of equals."""
    some = slice(None, None, max(1, len(target) // MOST_ROWS))
    design, wanted = terms[some] / steps[some, None], target[some] / steps[some]
    weights = np.zeros(terms.shape[1])
    heed = np.ones(len(wanted))
    for _ in range(N_FITS):
        heeded = design * heed[:, None]
        normal, right = np.einsum("pt,pu->tu", heeded, design), np.einsum("pt,p->t", heeded, wanted)  # no threads
        weights = np.linalg.pinv(normal, hermitian=True) @ right
        heed = 1 / (1 + np.abs(wanted - np.einsum("pt,t->p", design, weights)))
    sent = np.clip(np.rint(weights * (1 << WEIGHT_BITS)), -MAX_WEIGHT, MAX_WEIGHT)
    return np.asarray(sent.astype(np.int64))
