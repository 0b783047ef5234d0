"""Float32 numbers as a leading symbol, a following one and noise, and back.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.codec.float_column import Column, bit_length, magnitudes

__all__ = ["Symbols", "direct_symbols", "join_direct", "join_residual", "residual_symbols"]

MANTISSA_BITS = 23
NOISE_BITS = 19  # of a number told directly: its mantissa but for four bits
SIGN = 1 << 31
DIFFERS, BELOW = 8, 4  # parts of a following symbol of a distance


class NoiseReader(Protocol):
    """Gives integers of given numbers of bits."""

    def read(self, lengths: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Read integers of these lengths."""


@dataclass(frozen=True)
class Symbols:
    """n numbers as they are sent.

    Args:
        lead: (n,) leading symbol: signed place of the exponent below the anchor, 0 for 0; or length of a distance less the anchor.
        next: (n,) following symbol, 0 to 15.
        has_next: (n,) whether it is sent.
        noise: (n,) the rest.
        lengths: (n,) its bits.
    """

    lead: Int[np.ndarray, " n"]
    next: Int[np.ndarray, " n"]
    has_next: Bool[np.ndarray, " n"]
    noise: Int[np.ndarray, " n"]
    lengths: Int[np.ndarray, " n"]


def direct_symbols(x: Float[np.ndarray, " n"], column: Column) -> Symbols:
    """Tell numbers by sign and exponent, four bits of the mantissa, and its rest."""
    bits, present = magnitudes(x), x.view(np.uint32) != 0
    place = np.where(present, column.anchor - (bits >> MANTISSA_BITS) + 1, 0)
    lead = np.where(np.signbit(x), -place, place)
    noise = (bits & ((1 << NOISE_BITS) - 1)) >> column.zeros
    return Symbols(lead, bits >> NOISE_BITS & 15, present, noise, (NOISE_BITS - column.zeros) * present)


def join_direct(
    lead: Int[np.ndarray, " p"], following: Int[np.ndarray, " p"], noise: NoiseReader, column: Column
) -> Int[np.ndarray, " p"]:
    """Give the bits of numbers told directly."""
    present = lead != 0
    rest = noise.read((NOISE_BITS - column.zeros) * present) << column.zeros
    bits = ((column.anchor + 1 - np.abs(lead)) << MANTISSA_BITS) | (following << NOISE_BITS) | rest
    return np.asarray(np.where(present, bits | np.where(lead < 0, SIGN, 0), 0))


def residual_symbols(x: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], column: Column) -> Symbols:
    """Tell numbers by how far their bits are from those of what is expected."""
    distance = (magnitudes(x) >> column.zeros) - (magnitudes(expected) >> column.zeros)
    size = np.abs(distance)
    length = bit_length(size)
    top = (size << 2 >> np.maximum(length - 1, 0)) & 3
    following = DIFFERS * (np.signbit(x) != np.signbit(expected)) + BELOW * (distance < 0) + top
    n_noise = np.maximum(length - 3, 0)
    return Symbols(length - column.anchor, following, np.ones(len(x), bool), size & ((1 << n_noise) - 1), n_noise)


def join_residual(
    lead: Int[np.ndarray, " p"],
    following: Int[np.ndarray, " p"],
    noise: NoiseReader,
    expected: Float[np.ndarray, " p"],
    column: Column,
) -> Int[np.ndarray, " p"]:
    """Give the bits of numbers told by their distance; negative where that leaves all numbers."""
    length = lead + column.anchor
    n_noise = np.maximum(length - 3, 0)
    leading = np.where(length > 0, 4 | (following & 3), 0) << np.maximum(length - 3, 0) >> np.maximum(3 - length, 0)
    size = leading | noise.read(n_noise)
    near = magnitudes(expected) >> column.zeros
    bits = np.where(following & BELOW, near - size, near + size) << column.zeros
    negative = np.signbit(expected) != (following >= DIFFERS)
    return np.asarray(np.where((bits < 0) | (bits >= SIGN), -1, bits | np.where(negative, SIGN, 0)))
