"""One step of Adam."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TINIEST = np.float32(1e-37)  # just above where float32 becomes denormal and arithmetic slow


@njit(cache=True, nogil=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def adam_range(value, gradient, mean, square, rate, beta1, beta2, rest1, rest2, epsilon, square_correction):
    """Step some values; moments too small for a normal number become 0.

    Args:
        value: (p,) float32, changed.
        gradient: (p,) float32.
        mean: (p,) float32, first moment, changed.
        square: (p,) float32, second moment, changed.
        rate: learning rate over the first moment's bias correction.
        beta1: decay of the first moment.
        beta2: decay of the second moment.
        rest1: 1 - beta1, rounded once: from the rounded 0.999 it would be off by 5e-5.
        rest2: 1 - beta2, likewise.
        epsilon: beside the root of the second moment.
        square_correction: one over the root of the second moment's bias correction.
    """
    zero = np.float32(0)
    for i in range(len(value)):
        slope = gradient[i]
        m = beta1 * mean[i] + rest1 * slope
        s = beta2 * square[i] + rest2 * slope * slope
        m = m if abs(m) > TINIEST else zero
        s = s if s > TINIEST else zero
        mean[i] = m
        square[i] = s
        value[i] -= rate * m / (math.sqrt(s) * square_correction + epsilon)
