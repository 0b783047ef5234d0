"""Attributes coded pass by pass: each value predicted from those already decoded, the difference quantised and entropy coded.

Encoder and decoder run the same prediction on the same reconstructed integers, so that errors never add up. How values are predicted
(`prediction`), under which contexts levels are coded (`contexts`) and which level a residual gets (`choice`) is plugged in.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.choice import Nearest
from sacha_core.codec.contexts import ContextPlan
from sacha_core.codec.order import Layout
from sacha_core.codec.prediction import LIMIT, Mixture, fit_mixture
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["decode_predicted", "encode_predicted"]

NEAREST = Nearest()


def encode_predicted(
    layout: Layout,
    values: Int[np.ndarray, "n c"],
    steps: Int[np.ndarray, "n w"],
    plan: ContextPlan,
    chooser: Nearest = NEAREST,
) -> tuple[bytes, Int[np.ndarray, "n c"]]:
    """Code integers of fine units.

    Args:
        layout: where the Gaussians lie.
        values: in fine units.
        steps: of each Gaussian, one for all components or one each.
        plan: contexts.
        chooser: which level each residual gets.

    Returns:
        The bytes, and the values as the decoder will have them.
    """
    steps = np.broadcast_to(steps, values.shape)
    predictor = fit_mixture(layout, values)
    writer = SymbolWriter(plan.n_contexts)
    decoded, levels = np.zeros(values.shape, np.int64), np.zeros(values.shape, np.int64)
    for step in layout.passes:
        rows = step.rows
        expected = predictor.predict(step, decoded)
        for component in range(values.shape[1]):
            contexts = plan.contexts(step, component, levels)
            residual = values[rows, component] - expected[:, component]
            chosen = chooser.choose(step, component, residual, steps[rows, component], contexts)
            writer.write(chosen, contexts)
            levels[rows, component] = chosen
        decoded[rows] = expected + levels[rows] * steps[rows]
    return predictor.pack() + writer.finish(), decoded


def decode_predicted(
    reader: ByteReader, layout: Layout, steps: Int[np.ndarray, "n w"], plan: ContextPlan
) -> Int[np.ndarray, "n c"]:
    """Read what `encode_predicted` wrote, to the end of the section.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    shape = (len(layout.slots), plan.n_components)
    steps = np.broadcast_to(steps, shape)
    predictor = Mixture.unpack(reader, plan.n_components)
    symbols = SymbolReader(reader, plan.n_contexts)
    decoded, levels = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    for step in layout.passes:
        rows = step.rows
        for component in range(plan.n_components):
            levels[rows, component] = symbols.read(plan.contexts(step, component, levels))
        values = predictor.predict(step, decoded) + levels[rows] * steps[rows]
        if np.abs(values).max(initial=0) > LIMIT:
            raise reader.error(f"a value is beyond +-{LIMIT} units")
        decoded[rows] = values
    symbols.check_end()
    return decoded
