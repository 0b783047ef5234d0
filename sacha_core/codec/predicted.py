"""Attributes coded pass by pass: each value predicted from those already decoded, the difference quantised and entropy coded.

Encoder and decoder run the same prediction on the same reconstructed integers, so that errors never add up.

Source: own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import KINDS, MATES, Layout, Pass, mean_of_mates
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import quantise
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["LIMIT", "ContextPlan", "decode_predicted", "encode_predicted"]

LIMIT = 1 << 40  # no attribute comes near; a decoder stops before sums could leave 64 bits
FULL = 16  # prediction weights are in sixteenths


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

    def contexts(self, step: Pass) -> Int[np.ndarray, "p c"]:
        """Context of each component of each Gaussian of a pass."""
        inner = step.kind * self.n_classes + self.classes[step.rows]
        return np.asarray(np.arange(self.n_components) * (KINDS * self.n_classes) + inner[:, None])


class Reference:
    """What the values of a pass are predicted from: neighbours or mates, drawn towards the centre by a weight.

    Args:
        layout: where the Gaussians lie.
        centre: (c,) what is expected of a Gaussian of which nothing is known.
        weights: (KINDS, c) trust in the neighbours, in sixteenths.
    """

    def __init__(self, layout: Layout, centre: Int[np.ndarray, " c"], weights: Int[np.ndarray, "k c"]) -> None:
        self._centre = centre
        self._weights = weights
        self.values = np.zeros((len(layout.slots), len(centre)), np.int64)
        self._sums = np.zeros((len(layout.firsts), len(centre)), np.int64)
        self._known = np.zeros(len(layout.firsts), np.int64)

    def neighbours(self, step: Pass) -> Int[np.ndarray, "p c"]:
        """Mean of what is known beside each Gaussian of a pass."""
        if step.kind == MATES:
            return mean_of_mates(self._sums[step.slot], self._known[step.slot])
        return np.asarray((self.values[step.left] + self.values[step.right] + 1) >> 1)

    def predict(self, step: Pass) -> Int[np.ndarray, "p c"]:
        """Expected values of a pass; the very first Gaussian's is the centre."""
        if step.kind != MATES and step.rows[0] == step.left[0]:
            return self._centre[None]
        away = self.neighbours(step) - self._centre
        return np.asarray(self._centre + ((away * self._weights[step.kind] + FULL // 2) >> 4))

    def learn(self, step: Pass, values: Int[np.ndarray, "p c"]) -> None:
        """Take in the reconstructed values of a pass."""
        self.values[step.rows] = values
        np.add.at(self._sums, step.slot, values)
        np.add.at(self._known, step.slot, 1)


def fit_weights(
    layout: Layout, values: Int[np.ndarray, "n c"], centre: Int[np.ndarray, " c"]
) -> Int[np.ndarray, "k c"]:
    """Least-squares trust in the neighbours for each kind of pass and component, from the values before quantisation."""
    n_components = values.shape[1]
    products = np.zeros((KINDS, 2, n_components))
    exact = Reference(layout, centre, np.full((KINDS, n_components), FULL))
    for step in layout.passes:
        if not (step.kind != MATES and step.rows[0] == step.left[0]):
            away = (exact.neighbours(step) - centre).astype(np.float64)
            products[step.kind, 0] += (away * (values[step.rows] - centre)).sum(axis=0)
            products[step.kind, 1] += (away * away).sum(axis=0)
        exact.learn(step, values[step.rows])
    return np.clip(np.rint(FULL * products[:, 0] / np.maximum(products[:, 1], 1)), 0, FULL).astype(np.int64)


def encode_predicted(
    layout: Layout,
    values: Int[np.ndarray, "n c"],
    steps: Int[np.ndarray, "n w"],
    plan: ContextPlan,
    dead_zone: float = 0.0,
) -> tuple[bytes, Int[np.ndarray, "n c"]]:
    """Code integers of fine units.

    Args:
        layout: where the Gaussians lie.
        values: in fine units.
        steps: of each Gaussian, one for all components or one each.
        plan: contexts.
        dead_zone: how much further than half a step a difference may be and still become zero.

    Returns:
        The bytes, and the values as the decoder will have them.
    """
    centre = np.median(values, axis=0).astype(np.int64) if len(values) else np.zeros(values.shape[1], np.int64)
    weights = fit_weights(layout, values, centre)
    reference = Reference(layout, centre, weights)
    writer = SymbolWriter(plan.n_contexts)
    for step in layout.passes:
        expected = reference.predict(step)
        levels = quantise(values[step.rows] - expected, steps[step.rows], dead_zone)
        writer.write(levels, plan.contexts(step))
        reference.learn(step, expected + levels * steps[step.rows])
    head = struct.pack(f"<{len(centre)}q", *centre) + weights.astype(np.uint8).tobytes()
    return head + writer.finish(), reference.values


def decode_predicted(
    reader: ByteReader, layout: Layout, steps: Int[np.ndarray, "n w"], plan: ContextPlan
) -> Int[np.ndarray, "n c"]:
    """Read what `encode_predicted` wrote, to the end of the section.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    n_components = plan.n_components
    centre = np.array(reader.unpack(f"{n_components}q"), np.int64)
    if np.abs(centre.astype(np.float64)).max(initial=0) > LIMIT:
        raise reader.error(f"a centre is beyond +-{LIMIT} units")
    weights = np.frombuffer(reader.take(KINDS * n_components), np.uint8).reshape(KINDS, n_components).astype(np.int64)
    if weights.max(initial=0) > FULL:
        raise reader.error(f"a prediction weight of {weights.max()} sixteenths")
    reference = Reference(layout, centre, weights)
    symbols = SymbolReader(reader, plan.n_contexts)
    for step in layout.passes:
        values = reference.predict(step) + symbols.read(plan.contexts(step)) * steps[step.rows]
        if np.abs(values).max(initial=0) > LIMIT:
            raise reader.error(f"a value is beyond +-{LIMIT} units")
        reference.learn(step, values)
    symbols.check_end()
    return reference.values
