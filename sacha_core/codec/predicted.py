"""Attributes coded pass by pass: each value predicted from those already decoded, the difference quantised and entropy coded.

Encoder and decoder run the same prediction on the same reconstructed integers, so that errors never add up. How values are predicted
(`prediction`), under which contexts levels are coded (`contexts`) and which level a difference gets (`choice`) is plugged in.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.choice import PLAIN, Chooser, Worth
from sacha_core.codec.contexts import SIZE_CLASSES, ContextPlan, Sizes
from sacha_core.codec.fitting import fit_plan
from sacha_core.codec.order import Layout
from sacha_core.codec.prediction import LIMIT, Mixture, fit_mixture
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["decode_predicted", "encode_predicted"]


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
    predictor = fit_mixture(layout, values)
    levels, decoded = choose_levels(layout, values, steps, predictor, None, Chooser())
    plan = fit_plan(layout, levels, steps)
    if worth.lagrangian > 0:
        bits = write_levels(layout, levels, steps, plan).level_bits()
        levels, decoded = choose_levels(layout, values, steps, predictor, plan, Chooser(worth, bits))
        plan = fit_plan(layout, levels, steps)
    return predictor.pack() + plan.pack() + write_levels(layout, levels, steps, plan).finish(), decoded


def choose_levels(
    layout: Layout,
    values: Int[np.ndarray, "n c"],
    steps: Int[np.ndarray, "n c"],
    predictor: Mixture,
    plan: ContextPlan | None,
    chooser: Chooser,
) -> tuple[Int[np.ndarray, "n c"], Int[np.ndarray, "n c"]]:
    """Run prediction and quantisation; give the levels and the values as decoded. Without a plan all contexts are 0."""
    sizes = Sizes(steps)
    decoded, levels = np.zeros(values.shape, np.int64), np.zeros(values.shape, np.int64)
    for step in layout.passes:
        rows = step.rows
        expected = predictor.predict(step, decoded)
        if plan:
            sizes.enter(step)
        for component in range(values.shape[1]):
            contexts = sizes.contexts(plan, component) if plan else np.zeros(len(rows), np.int64)
            residual = values[rows, component] - expected[:, component]
            chosen = chooser.choose(rows, component, residual, steps[rows, component], contexts)
            levels[rows, component] = chosen
            if plan:
                sizes.learn(component, chosen)
        decoded[rows] = expected + levels[rows] * steps[rows]
    return levels, decoded


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
    steps = np.broadcast_to(steps, shape)
    predictor = Mixture.unpack(reader, n_components)
    plan = ContextPlan.unpack(reader, n_components)
    symbols = SymbolReader(reader, SIZE_CLASSES)
    sizes = Sizes(steps)
    decoded, levels = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    for step in layout.passes:
        rows = step.rows
        sizes.enter(step)
        for component in range(n_components):
            found = symbols.read(sizes.contexts(plan, component))
            sizes.learn(component, found)
            levels[rows, component] = found
        values = predictor.predict(step, decoded) + levels[rows] * steps[rows]
        if np.abs(values).max(initial=0) > LIMIT:
            raise reader.error(f"a value is beyond +-{LIMIT} units")
        decoded[rows] = values
    symbols.check_end()
    return decoded
