"""One step of Adam."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sacha_core.raster.kernels.harmonics import direction, evaluate

TINIEST = np.float32(1e-37)  # just above where float32 becomes denormal and arithmetic slow
FAST = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
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


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def harmonics_range(
    start, stop, degree, basis, means, centres, cuts, value, mean, square, rate, beta1, beta2, rest1, rest2, epsilon, square_correction
):  # fmt: skip
    """Step the harmonics of degree 1 to `degree` of the Gaussians `start` to `stop`."""
    values, gradient = np.zeros(16, np.float32), np.zeros(45, np.float32)
    width = 3 * ((degree + 1) ** 2 - 1)
    for g in range(start, stop):
        gradient[:] = 0
        for view in range(len(centres)):
            x, y, z, _ = direction(means, centres[view], g, basis)
            evaluate(x, y, z, degree, basis, values)
            for k in range((degree + 1) ** 2 - 1):
                for c in range(3):
                    gradient[3 * k + c] += values[k + 1] * cuts[view][g, c]
        adam_range(
            value[g, :width], gradient[:width], mean[g, :width], square[g, :width],
            rate, beta1, beta2, rest1, rest2, epsilon, square_correction,
        )  # fmt: skip
