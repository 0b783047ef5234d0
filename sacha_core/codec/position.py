"""Section `Position`: means in the frames of their triangles.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, PER_OCTAVE, STEPS, Classes, StepRule, dequantise

__all__ = ["decode_position", "encode_position"]

UNIT = 2.0**-16  # of a triangle's scale
DOMAIN_TRIANGLE = 0  # the only domain of version 1; others are to come


def position_steps(layout: Layout, classes: Classes, rule: StepRule) -> Int[np.ndarray, "n 1"]:
    """Steps in triangle units that are alike in metres."""
    exponent = rule.base + rule.shift(classes) - layout.triangle_size * (PER_OCTAVE // 2)  # sizes are half octaves
    return np.asarray(STEPS[np.clip(exponent, 0, MAX_EXPONENT)])[:, None]


def encode_position(
    layout: Layout, position: Float[np.ndarray, "n 3"], classes: Classes, rule: StepRule, worth: Worth = PLAIN
) -> tuple[bytes, Int[np.ndarray, "n 3"]]:
    """Code positions; give the section and the decoder's integers."""
    values = np.rint(position.astype(np.float64) / UNIT).astype(np.int64)
    coded, decoded = encode_predicted(layout, values, position_steps(layout, classes, rule), worth)
    return bytes([DOMAIN_TRIANGLE]) + rule.pack() + coded, decoded


def decode_position(reader: ByteReader, layout: Layout, classes: Classes) -> Float[np.ndarray, "n 3"]:
    """Read positions.

    Raises:
        FormatError: an unknown domain, or bytes that no encoder writes.
    """
    (domain,) = reader.unpack("B")
    if domain != DOMAIN_TRIANGLE:
        raise reader.error(f"positions in domain {domain}; this decoder knows 0, the triangle's frame")
    rule = StepRule.unpack(reader)
    return dequantise(decode_predicted(reader, layout, position_steps(layout, classes, rule), 3), UNIT)
