"""The Gaussian window of SSIM, separable: eleven taps along a row, then across rows, on sixteen lanes.

The window is symmetric, so that six products do for eleven taps.
"""

from __future__ import annotations

import math

import numpy as np

from sacha_core.parallel.kernels.lanes import fma, inlined, load, splat

RADIUS = 5
_taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
_taps /= math.fsum(_taps)
W0, W1, W2, W3, W4, W5 = (np.float32(tap) for tap in _taps[: RADIUS + 1])


@inlined
def weighted(a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10):
    """Give the weighted sum of eleven values."""
    total = fma(splat(W4), a4 + a6, splat(W5) * a5)
    total = fma(splat(W3), a3 + a7, total)
    total = fma(splat(W2), a2 + a8, total)
    total = fma(splat(W1), a1 + a9, total)
    return fma(splat(W0), a0 + a10, total)


@inlined
def blur_along(a, at):
    """Blur along a row: give the sixteen means around `at` and the numbers after it."""
    return weighted(
        load(a, at - 5), load(a, at - 4), load(a, at - 3), load(a, at - 2), load(a, at - 1), load(a, at),
        load(a, at + 1), load(a, at + 2), load(a, at + 3), load(a, at + 4), load(a, at + 5),
    )  # fmt: skip


@inlined
def blur_across(a, rows, at, pitch):
    """Blur fourteen rows into the four in their middle; `rows` tells where the first, fifth, ninth and thirteenth begin."""
    first, second, third, fourth = rows[0] + at, rows[1] + at, rows[2] + at, rows[3] + at
    a0, a1, a2, a3 = load(a, first), load(a, first + pitch), load(a, first + 2 * pitch), load(a, first + 3 * pitch)
    a4, a5, a6 = load(a, second), load(a, second + pitch), load(a, second + 2 * pitch)
    a7, a8, a9 = load(a, second + 3 * pitch), load(a, third), load(a, third + pitch)
    a10, a11 = load(a, third + 2 * pitch), load(a, third + 3 * pitch)
    a12, a13 = load(a, fourth), load(a, fourth + pitch)
    return (
        weighted(a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10),
        weighted(a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11),
        weighted(a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12),
        weighted(a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13),
    )


@inlined
def blur_moments(a, p, q):
    """Blur two rows and their squares along: from memory once, squared on the way."""
    p0, q0 = load(a, p), load(a, q)
    mean_p, mean_q = splat(W5) * p0, splat(W5) * q0
    moments = mean_p, mean_q, mean_p * p0, mean_q * q0
    moments = _add_pair(moments, W4, load(a, p - 1), load(a, p + 1), load(a, q - 1), load(a, q + 1))
    moments = _add_pair(moments, W3, load(a, p - 2), load(a, p + 2), load(a, q - 2), load(a, q + 2))
    moments = _add_pair(moments, W2, load(a, p - 3), load(a, p + 3), load(a, q - 3), load(a, q + 3))
    moments = _add_pair(moments, W1, load(a, p - 4), load(a, p + 4), load(a, q - 4), load(a, q + 4))
    return _add_pair(moments, W0, load(a, p - 5), load(a, p + 5), load(a, q - 5), load(a, q + 5))


@inlined
def _add_pair(moments, tap, p0, p1, q0, q1):
    """Add two pixels of both rows, which have the same weight."""
    mean_p, mean_q, square_p, square_q = moments
    weight = splat(tap)
    return (
        fma(weight, p0 + p1, mean_p),
        fma(weight, q0 + q1, mean_q),
        fma(weight, fma(p0, p0, p1 * p1), square_p),
        fma(weight, fma(q0, q0, q1 * q1), square_q),
    )
