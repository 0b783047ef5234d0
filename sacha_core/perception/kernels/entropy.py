"""Binary cross-entropy of one channel with its gradient, over a band of rows."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    every,
    exponent,
    fma,
    inlined,
    mantissa,
    maximum,
    minimum,
    number,
    ramp,
    select,
    splat,
    sums,
    zeros,
)
from sacha_core.perception.kernels.pixels import pixels, write

F = np.float32
LOWEST = F(1e-6)
HIGHEST = F(1 - 1e-6)
LN_2 = F(np.log(2))
SQRT_2 = F(np.sqrt(2))


@inlined
def logarithm(x, complement):
    """Give ln x for x in (0, 1), by the series of artanh((m - 1) / (m + 1)); `complement` is 1 - x, which x near 1 has lost."""
    m = mantissa(x)
    large = m > SQRT_2
    m = select(large, m * F(0.5), m)
    whole = select(large, exponent(x) + F(1), exponent(x))
    s = select(whole >= F(0), -complement, m - F(1)) / (m + F(1))
    z = s * s
    series = fma(z, splat(F(2 / 9)), splat(F(2 / 7)))
    series = fma(series, z, splat(F(2 / 5)))
    series = fma(series, z, splat(F(2 / 3)))
    return fma(whole, splat(LN_2), s * fma(series, z, splat(F(2))))


@inlined
def cross_entropy(value, wanted, weight):
    """Give the cross-entropy of sixteen pixels, and `weight` times its slope, which is zero where the clamp acts."""
    one, nothing = splat(F(1)), zeros()
    inside = minimum(splat(HIGHEST), maximum(splat(LOWEST), value))  # in this order what is not a number stays so
    absent = one - inside
    slope = splat(weight) * (inside - wanted) / (inside * absent)
    slope = select(value < LOWEST, nothing, select(value > HIGHEST, nothing, slope))
    log_absent = logarithm(absent, inside)
    return -fma(wanted, logarithm(inside, absent) - log_absent, log_absent), slope


@kernel
def entropy_band(image, image_at, target, target_at, pitch, top, bottom, width, weight, gradient, nats):
    """Write the gradient of `weight` times the summed cross-entropy, of the prediction clamped to [1e-6, 1 - 1e-6].

    Args:
        image: flat float32.
        image_at: where the predicted channel begins; its rows lie `width` apart.
        target: flat uint8, 255 stands for 1.
        target_at: where it begins.
        pitch: from row to row of `target`.
        top: first row.
        bottom: one past the last row.
        width: of the image.
        weight: float32.
        gradient: flat, laid out as `image`; out.
        nats: (h,) float32 out, the cross-entropy summed over each row but for the pixels where nothing is wanted or given.

    Returns:
        How many pixels that are.
    """
    nothing, lane = zeros(), ramp()
    empty = 0
    for y in range(top, bottom):
        row, wanted_row = image_at + y * width, target_at + y * pitch
        total = nothing
        for x in range(0, width, LANES):
            count = width - x
            value, wanted = pixels(image, row + x, target, wanted_row + x, F(1 / 255), count)
            if every((value >= F(0)) & (value <= F(0)) & (wanted <= F(0))):
                slope = nothing
                empty += min(count, LANES)
            else:
                entropy, slope = cross_entropy(value, wanted, weight)
                total = total + select(lane < F(count), entropy, nothing)
            write(gradient, row + x, count, slope)
        nats[y] = number(sums((total,)), 0)
    return empty
