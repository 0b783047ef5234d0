"""Section `Harmonic`: spherical-harmonics coefficients of degree 1 and up, most of which are zero after quantisation.

They are coded degree by degree, each coefficient under a context of how much its Gaussian spent on the degrees before.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.colour import UNIT, Rules, rgb_to_yuv, yuv_to_rgb
from sacha_core.codec.prediction import LIMIT
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import Classes, StepRule, quantise
from sacha_core.codec.symbols import SymbolReader, SymbolWriter

__all__ = ["decode_harmonics", "encode_harmonics"]

BANDS = ((0, 3), (3, 8), (8, 15))  # coefficients of degree 1, 2, 3
CHANNELS = 2  # luma; the two differences together
ACTIVITY = 4
SPREAD = 6  # classes of the step


def n_bands(n_harmonics: int) -> int:
    """How many degrees above 0 there are."""
    return sum(1 for _, end in BANDS if end <= n_harmonics)


def band_steps(rules: Rules, band: int, classes: Classes) -> Int[np.ndarray, "n 1 3"]:
    """Steps of one degree: rules are luma by degree, then the differences by degree."""
    luma, differences = rules[band].steps(classes), rules[len(rules) // 2 + band].steps(classes)
    return np.stack([luma, differences, differences], axis=1)[:, None]


def activity_of(spent: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Class 0 to 3 of the sum of magnitudes in the degrees before."""
    return np.minimum(np.frexp(spent.astype(np.float64))[1], ACTIVITY - 1).astype(np.int64)


def band_contexts(
    band: int, step_class: Int[np.ndarray, " n"], spent: Int[np.ndarray, "n 2"], width: int
) -> Int[np.ndarray, "n k 3"]:
    """Context of every coefficient of one degree: degree, channel, step, activity of the channel."""
    step = np.minimum(step_class, SPREAD - 1)
    luma = ((band * CHANNELS + 0) * SPREAD + step) * ACTIVITY + activity_of(spent[:, 0])
    differences = ((band * CHANNELS + 1) * SPREAD + step) * ACTIVITY + activity_of(spent[:, 1])
    return np.repeat(np.stack([luma, differences, differences], axis=1)[:, None], width, axis=1)


def spend(spent: Int[np.ndarray, "n 2"], levels: Int[np.ndarray, "n k 3"]) -> Int[np.ndarray, "n 2"]:
    """Add the magnitudes of a degree to what luma and differences have spent."""
    magnitude = np.abs(levels).sum(axis=1)
    return np.asarray(spent + np.stack([magnitude[:, 0], magnitude[:, 1] + magnitude[:, 2]], axis=1))


def encode_harmonics(
    sh_rest: Float[np.ndarray, "n k 3"], classes: Classes, rules: Rules, dead_zone: float
) -> tuple[bytes, Int[np.ndarray, "n k 3"]]:
    """Code coefficients; give the section and the decoder's integers."""
    n, n_harmonics, _ = sh_rest.shape
    values = np.rint(rgb_to_yuv(sh_rest) / UNIT).astype(np.int64)
    decoded = np.zeros_like(values)
    bands = n_bands(n_harmonics)
    used = (*rules[:bands], *rules[len(rules) // 2 : len(rules) // 2 + bands])
    writer = SymbolWriter(len(BANDS) * CHANNELS * SPREAD * ACTIVITY)
    spent = np.zeros((n, 2), np.int64)
    for band, (start, end) in enumerate(BANDS[:bands]):
        steps = band_steps(used, band, classes)
        levels = quantise(values[:, start:end], steps, dead_zone)
        writer.write(levels, band_contexts(band, used[band].step_class(classes), spent, end - start))
        decoded[:, start:end] = levels * steps
        spent = spend(spent, levels)
    return b"".join(rule.pack() for rule in used) + writer.finish(), decoded


def decode_harmonics(reader: ByteReader, n: int, n_harmonics: int, classes: Classes) -> Float[np.ndarray, "n k 3"]:
    """Read coefficients.

    Raises:
        FormatError: the bytes are not what an encoder writes.
    """
    bands = n_bands(n_harmonics)
    rules = tuple(StepRule.unpack(reader) for _ in range(2 * bands))
    symbols = SymbolReader(reader, len(BANDS) * CHANNELS * SPREAD * ACTIVITY)
    decoded = np.zeros((n, n_harmonics, 3), np.int64)
    spent = np.zeros((n, 2), np.int64)
    for band, (start, end) in enumerate(BANDS[:bands]):
        levels = symbols.read(band_contexts(band, rules[band].step_class(classes), spent, end - start))
        decoded[:, start:end] = levels * band_steps(rules, band, classes)
        spent = spend(spent, levels)
    symbols.check_end()
    if np.abs(decoded).max(initial=0) > LIMIT:
        raise reader.error(f"a coefficient is beyond +-{LIMIT} units")
    return yuv_to_rgb(decoded)
