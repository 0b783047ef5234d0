"""Rounding that makes a ranking reproducible."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["rounded"]

SMALLEST = 1e-300  # the unit of a smaller number would be none itself; it is rounded to 0


def rounded(score: Float[np.ndarray, " n"], digits: int = 6) -> Float[np.ndarray, " n"]:
    """Round to a number of significant digits, so that float noise in sums cannot swap near ties.

    Args:
        score: (n,) not negative.
        digits: significant decimal digits to keep.
    """
    value = np.asarray(score, np.float64)
    exponent = np.floor(np.log10(value, where=value >= SMALLEST, out=np.zeros_like(value)))
    unit = np.power(10.0, exponent - (digits - 1))
    short: np.ndarray = np.rint(value / unit) * unit
    return short
