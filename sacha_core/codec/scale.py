r"""Section `Scale`: logarithms of the three standard deviations, largest first.

Sorting costs nothing, since the rotation is turned to match (`rotation.sort_axes`). Scales are coded as if every triangle had the size of
the middle one, so that neighbours on triangles of other sizes predict them.

Source: own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import Classes, StepRule, dequantise

__all__ = ["classes_of", "coded_scales", "decode_scale", "encode_scale", "known_classes", "steps_of"]

UNIT = 2.0**-12  # of a natural logarithm
HALF_OCTAVES = 189093  # 2 / ln 2 in 16 fractional bits: half octaves in a natural logarithm
HALF_OCTAVE_SHIFT = 28
NATURAL = 90852  # an eighth of an octave, ln 2 / 8, in 256ths of `UNIT`


def known_classes(transparency: Int[np.ndarray, " n"], hidden: Int[np.ndarray, " n"]) -> Classes:
    """Classes as far as they are known before scales are."""
    zero = np.zeros_like(transparency)
    return Classes(transparency, zero, zero, hidden)


def classes_of(known: Classes, scale: Int[np.ndarray, "n 3"]) -> Classes:
    """Classes from those known before and decoded scales (integers in `UNIT`, largest first)."""
    size = ((scale[:, 0] + scale[:, 1]) * HALF_OCTAVES) >> (HALF_OCTAVE_SHIFT + 1)
    elongation = np.maximum((scale[:, 0] - scale[:, 1]) * HALF_OCTAVES >> HALF_OCTAVE_SHIFT, 0)
    return replace(known, size=size, elongation=elongation)


def triangle_log_size(layout: Layout) -> Int[np.ndarray, " n"]:
    """Logarithm of the size of each Gaussian's triangle over the middle one's, in `UNIT`."""
    return np.asarray(layout.triangle_size * NATURAL >> 8)


def encode_scale(
    layout: Layout,
    log_scale: Float[np.ndarray, "n 3"],
    classes: Classes,
    rules: tuple[StepRule, ...],
    worth: Worth = PLAIN,
) -> tuple[bytes, Int[np.ndarray, "n 3"]]:
    """Code log-scales, sorted largest first, over the size of the middle triangle rather than their own.

    Returns:
        The section and the integers that the decoder will have.
    """
    coded, decoded = encode_predicted(layout, coded_scales(layout, log_scale), steps_of(rules, classes), worth)
    return b"".join(rule.pack() for rule in rules) + coded, decoded


def coded_scales(layout: Layout, log_scale: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n 3"]:
    """Integers that stand for sorted log-scales."""
    return np.asarray(
        np.rint(log_scale.astype(np.float64) / UNIT).astype(np.int64) + triangle_log_size(layout)[:, None]
    )


def scales_in_triangles(layout: Layout, scale: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Log-scales that integers stand for, float32."""
    return dequantise(scale - triangle_log_size(layout)[:, None], UNIT)


def steps_of(rules: tuple[StepRule, ...], classes: Classes) -> Int[np.ndarray, "n 3"]:
    """Steps of the three scales."""
    return np.stack([rule.steps(classes) for rule in rules], axis=1)


def decode_scale(
    reader: ByteReader, layout: Layout, classes: Classes
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n 3"]]:
    """Read log-scales: as float32, and as the integers that steps of further attributes follow.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    rules = tuple(StepRule.unpack(reader) for _ in range(3))
    scale = decode_predicted(reader, layout, steps_of(rules, classes), 3)
    return scales_in_triangles(layout, scale), scale
