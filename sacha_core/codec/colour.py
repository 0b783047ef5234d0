"""Section `Colour`: spherical-harmonics coefficients of degree 0, as luma and two colour differences.

Source: matrices of ITU-R BT.470, as the MPEG splat mapping uses them; coding: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.choice import PLAIN, Worth
from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import Classes, StepRule

__all__ = ["TO_RGB", "UNIT", "decode_colour", "encode_colour", "rgb_to_yuv", "yuv_to_rgb"]

UNIT = 2.0**-14
TO_YUV = np.array([[0.299, 0.587, 0.114], [-0.14713, -0.28886, 0.436], [0.615, -0.51498, -0.10001]])
TO_RGB = np.array([[1.0, 0.0, 1.13983], [1.0, -0.39465, -0.5806], [1.0, 2.03211, 0.0]])

Rules = tuple[StepRule, ...]


def rgb_to_yuv(rgb: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Give luma and colour differences, float64."""
    return np.asarray(rgb.astype(np.float64) @ TO_YUV.T)


def yuv_to_rgb(yuv: Int[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """Give float32 RGB of integers in `UNIT`: products and sums of float64 in the order written, so that every machine agrees."""
    y, u, v = (yuv[..., channel].astype(np.float64) * UNIT for channel in range(3))
    red = y + 1.13983 * v
    green = (y - 0.39465 * u) - 0.5806 * v
    blue = y + 2.03211 * u
    return np.stack([red, green, blue], axis=-1).astype(np.float32)


def component_steps(rules: Rules, classes: Classes) -> Int[np.ndarray, "n 3"]:
    """Steps of luma and the two differences."""
    return np.stack([rule.steps(classes) for rule in rules], axis=1)


def encode_colour(
    layout: Layout, sh_dc: Float[np.ndarray, "n 3"], classes: Classes, rules: Rules, worth: Worth = PLAIN
) -> tuple[bytes, Int[np.ndarray, "n 3"]]:
    """Code colours; give the section and the decoder's integers."""
    values = np.rint(rgb_to_yuv(sh_dc) / UNIT).astype(np.int64)
    coded, decoded = encode_predicted(layout, values, component_steps(rules, classes), worth)
    return b"".join(rule.pack() for rule in rules) + coded, decoded


def decode_colour(reader: ByteReader, layout: Layout, classes: Classes) -> Float[np.ndarray, "n 3"]:
    """Read colours.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    rules = tuple(StepRule.unpack(reader) for _ in range(3))
    return yuv_to_rgb(decode_predicted(reader, layout, component_steps(rules, classes), 3))
