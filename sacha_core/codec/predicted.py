"""Attributes coded pass by pass: each value predicted from those already decoded, the difference quantised and entropy coded.

Encoder and decoder run the same prediction on the same reconstructed numbers, so that errors never add up. How values are predicted
(`prediction`, `turning`), under which contexts levels are coded (`contexts`) and which level a difference gets (`choice`) is plugged in.

Source: own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Int

from sacha_core.codec.choice import PLAIN, Chooser, Worth
from sacha_core.codec.contexts import SIZE_CLASSES, ContextPlan, Sizes
from sacha_core.codec.fitting import fit_plan
from sacha_core.codec.order import Layout
from sacha_core.codec.prediction import LIMIT, Linear, Mixture, Prediction, fit_mixture
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["decode_levels", "decode_predicted", "encode_levels", "encode_predicted", "rough_bits"]

P = TypeVar("P", bound=Prediction)


def encode_predicted(
    layout: Layout, values: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n w"], worth: Worth = PLAIN
) -> tuple[bytes, Int[np.ndarray, "n c"]]:
    """Code integers of fine units.

    Args:
        layout: where the Gaussians lie.
        values: in fine units.
        steps: of each Gaussian, one for all components or one each.
        worth: of errors and bits.

    Returns:
        The bytes, and the values as the decoder will have them.
    """
    steps = np.broadcast_to(steps, values.shape)
    mixture = fit_mixture(layout, values, steps)
    coded, known = encode_levels(layout, lambda: Linear(mixture, values), steps, worth)
    return mixture.pack() + coded, known.values


def encode_levels(
    layout: Layout, start: Callable[[], P], steps: Int[np.ndarray, "n c"], worth: Worth = PLAIN
) -> tuple[bytes, P]:
    """Code what a prediction leaves.

    Args:
        layout: where the Gaussians lie.
        start: makes the prediction anew; an encoder may run it several times.
        steps: quantiser steps.
        worth: of errors and bits.

    Returns:
        The bytes, and the prediction with all that was decoded.
    """
    levels, known = choose_levels(layout, start(), steps, None, Chooser())
    plan = fit_plan(layout, levels, steps)
    if worth.lagrangian > 0:
        bits = write_levels(layout, levels, steps, plan).level_bits()
        levels, known = choose_levels(layout, start(), steps, plan, Chooser(worth, bits))
        plan = fit_plan(layout, levels, steps)
    return plan.pack() + write_levels(layout, levels, steps, plan).finish(), known


def rough_bits(layout: Layout, values: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n w"]) -> float:
    """Give roughly the bits that `encode_predicted` would take, for encoders to compare."""
    steps = np.broadcast_to(steps, values.shape)
    levels, _ = choose_levels(layout, Linear(fit_mixture(layout, values, steps), values), steps, None, Chooser())
    return float(np.log2(1 + np.abs(levels)).sum())


def choose_levels(
    layout: Layout, known: P, steps: Int[np.ndarray, "n c"], plan: ContextPlan | None, chooser: Chooser
) -> tuple[Int[np.ndarray, "n c"], P]:
    """Run prediction and quantisation; give the levels and the prediction at its end. Without a plan all contexts are 0."""
    sizes = Sizes(steps)
    levels = np.zeros(steps.shape, np.int64)
    for step in layout.passes:
        rows = step.rows
        known.enter(step)
        if plan:
            sizes.enter(step)
        for component in range(steps.shape[1]):
            contexts = sizes.contexts(plan, component) if plan else np.zeros(len(rows), np.int64)
            chosen = chooser.choose(rows, component, known.residual(component), steps[rows, component], contexts)
            levels[rows, component] = chosen
            known.learn(component, chosen * steps[rows, component])
            if plan:
                sizes.learn(component, chosen)
    return levels, known


def write_levels(
    layout: Layout, levels: Int[np.ndarray, "n c"], steps: Int[np.ndarray, "n c"], plan: ContextPlan
) -> SymbolWriter:
    """Write levels under their contexts."""
    sizes = Sizes(steps)
    writer = SymbolWriter(SIZE_CLASSES)
    for step in layout.passes:
        sizes.enter(step)
        for component in range(levels.shape[1]):
            mine = levels[step.rows, component]
            writer.write(mine, sizes.contexts(plan, component))
            sizes.learn(component, mine)
    return writer


def decode_predicted(
    reader: ByteReader, layout: Layout, steps: Int[np.ndarray, "n w"], n_components: int
) -> Int[np.ndarray, "n c"]:
    """Read what `encode_predicted` wrote, to the end of the section.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    shape = (len(layout), n_components)
    known = Linear(Mixture.unpack(reader, n_components), np.zeros(shape, np.int64))
    decode_levels(reader, layout, known, np.broadcast_to(steps, shape))
    if np.abs(known.values).max(initial=0) > LIMIT:
        raise reader.error(f"a value is beyond +-{LIMIT} units")
    return known.values


def decode_levels(reader: ByteReader, layout: Layout, known: Prediction, steps: Int[np.ndarray, "n c"]) -> None:
    """Read what `encode_levels` wrote, to the end of the section, into a prediction.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    n_components = steps.shape[1]
    plan = ContextPlan.unpack(reader, n_components)
    symbols = SymbolReader(reader, SIZE_CLASSES)
    sizes = Sizes(steps)
    for step in layout.passes:
        rows = step.rows
        known.enter(step)
        sizes.enter(step)
        for component in range(n_components):
            levels = symbols.read(sizes.contexts(plan, component))
            sizes.learn(component, levels)
            known.learn(component, levels * steps[rows, component])
    symbols.check_end()
