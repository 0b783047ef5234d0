"""Rounding that makes a ranking reproducible."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["rounded"]


def rounded(score: Float[np.ndarray, " n"], digits: int = 6) -> Float[np.ndarray, " n"]:
    """Round to a number of significant digits, so that float noise in sums cannot swap near ties.

    Args:
        score: (n,) not negative.
        digits: significant decimal digits to keep.
    """
    value = np.asarray(score, np.float64)
    mantissa, exponent = np.frexp(value)
    step = np.power(10.0, np.floor(np.log10(np.ldexp(mantissa, exponent), where=value > 0, out=np.zeros_like(value))))
    unit = step / 10.0 ** (digits - 1)
    return np.rint(value / unit) * unit
