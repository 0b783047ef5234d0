r"""Integers of any size as a token of a small alphabet and a few raw bits.

Magnitudes below 16 are tokens of their own; above, a token names the octave and the next two bits, and the rest follow as raw bits:
inside a sixteenth to an eighth of its size a residual is as good as uniform. Tokens carry the sign: -MAX_TOKEN to MAX_TOKEN.

Source: own; the split is that of JPEG XL's hybrid integers (ISO/IEC 18181-1, C.2.3).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt

__all__ = ["DIRECT", "MAX_TOKEN", "MAX_VALUE", "join_tokens", "pack_bits", "raw_lengths", "split_tokens", "unpack_bits"]

DIRECT = 16
MANTISSA_BITS = 2
MAX_VALUE = (1 << 28) - 1
MAX_TOKEN = DIRECT + (28 - 4) * (1 << MANTISSA_BITS) - 1


def raw_lengths(tokens: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Number of raw bits that follow each token."""
    lengths = np.zeros(tokens.shape, np.int64)
    far = np.flatnonzero(np.abs(tokens) >= DIRECT)  # few
    lengths[far] = (np.abs(tokens[far]) - DIRECT) // (1 << MANTISSA_BITS) + 4 - MANTISSA_BITS
    return lengths


def split_tokens(values: Int[np.ndarray, " m"]) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Give the tokens of `values` (magnitudes up to MAX_VALUE) and the raw bits as integers."""
    tokens, raw = values.copy(), np.zeros_like(values)
    far = np.flatnonzero(np.abs(values) >= DIRECT)
    magnitude = np.abs(values[far])
    octave = np.frexp(magnitude.astype(np.float64))[1].astype(np.int64) - 1
    shift = octave - MANTISSA_BITS
    coarse = DIRECT + (octave - 4) * (1 << MANTISSA_BITS) + ((magnitude >> shift) & ((1 << MANTISSA_BITS) - 1))
    tokens[far] = np.where(values[far] < 0, -coarse, coarse)
    raw[far] = magnitude & ((1 << shift) - 1)
    return tokens, raw


def join_tokens(tokens: Int[np.ndarray, " m"], raw: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Give back the integers of `split_tokens`."""
    token = np.abs(tokens)
    length = raw_lengths(tokens)
    mantissa = (1 << MANTISSA_BITS) + (token - DIRECT) % (1 << MANTISSA_BITS)
    magnitude = np.where(token < DIRECT, token, (mantissa << length) + raw)
    return np.asarray(np.where(tokens < 0, -magnitude, magnitude))


def pack_bits(raw: Int[np.ndarray, " m"], lengths: Int[np.ndarray, " m"]) -> bytes:
    """Write each integer of `raw` in its number of bits, most significant first, the last byte filled with zeros."""
    ends = np.cumsum(lengths)
    place = np.repeat(ends, lengths) - np.arange(int(ends[-1]) if len(ends) else 0) - 1  # weight of every bit
    return np.packbits((np.repeat(raw, lengths) >> place & 1).astype(np.uint8)).tobytes()


def unpack_bits(bits: UInt[np.ndarray, " b"], start: int, lengths: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Read integers of the given numbers of bits from an array of bits, from `start` on."""
    ends = np.cumsum(lengths)
    n_bits = int(ends[-1]) if len(ends) else 0
    place = np.repeat(ends, lengths) - np.arange(n_bits) - 1
    weighted = bits[start : start + n_bits].astype(np.int64) << place
    sums = np.concatenate([[0], np.cumsum(weighted)])
    return np.asarray(sums[ends] - sums[ends - lengths])
