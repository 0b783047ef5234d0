"""Columns of few different float32 numbers: a list of these, then for each number its place in the list.

What was quantised before, as other codecs leave it, comes out small this way.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.float_column import bit_length, from_ordered, ordered
from sacha_core.codec.float_symbols import Symbols

__all__ = [
    "LENGTH_MIDDLE",
    "bits_at",
    "finite_bits",
    "join_list",
    "list_symbols",
    "listed_of",
    "place_of",
    "place_symbols",
]

LOWEST = -(1 << 31)
LENGTH_MIDDLE = 16  # of bit lengths, which are told as their difference to it
LARGEST_BITS = 0x7F7FFFFF  # of a finite number, without its sign


def listed_of(x: Float[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Give the different numbers of a column, as ordered integers, ascending."""
    return np.unique(ordered(x))


def list_symbols(
    listed: Int[np.ndarray, " m"],
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Give the symbols of a list, its noise, and how many bits of it each has: differences of ordered integers."""
    steps = np.diff(listed, prepend=LOWEST)
    length = bit_length(steps)
    n_noise = np.maximum(length - 1, 0)
    return length - LENGTH_MIDDLE, steps & ((1 << n_noise) - 1), n_noise


def join_list(length: Int[np.ndarray, " m"], noise: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """Give the ordered integers of a list."""
    steps = np.where(length > 0, (1 << np.maximum(length - 1, 0)) | noise, 0)
    return np.asarray(np.cumsum(steps) + LOWEST)


def finite_bits(listed: Int[np.ndarray, " m"]) -> bool:
    """Tell whether a list ascends through finite numbers."""
    bits = np.where(listed < 0, -1 - listed, listed)
    return bool((np.diff(listed) > 0).all() and (bits <= LARGEST_BITS).all())


def place_of(expected: Float[np.ndarray, " p"], listed: Int[np.ndarray, " m"]) -> Int[np.ndarray, " p"]:
    """Give the place in the list at which expected numbers would lie."""
    return np.minimum(np.searchsorted(listed, ordered(expected)), len(listed) - 1)


def place_symbols(x: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"]) -> Symbols:
    """Tell numbers by their places."""
    listed = listed_of(x)
    nothing = np.zeros(len(x), np.int64)
    lead = np.searchsorted(listed, ordered(x)) - place_of(expected, listed)
    return Symbols(lead, nothing, nothing > 0, nothing, nothing)


def bits_at(places: Int[np.ndarray, " p"], listed: Int[np.ndarray, " m"]) -> Int[np.ndarray, " p"]:
    """Give the bits of the numbers at places; -1 outside the list."""
    inside = (places >= 0) & (places < len(listed))
    return np.asarray(np.where(inside, from_ordered(listed[np.where(inside, places, 0)]), -1))
