"""One step of Adam."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    fma,
    inlined,
    load,
    load_first,
    prefetch_to_write,
    select,
    splat,
    square_root,
    store,
    store_first,
    zeros,
)
from sacha_core.parallel.kernels.packed import unpacked
from sacha_core.parallel.kernels.turns import take_turn
from sacha_core.raster.kernels.harmonics import NUMBERS, rest_gradients

F = np.float32
# Numbers by which memory is asked for ahead: the processor does not foresee what lies beyond a page of 4096 bytes, or where a range begins
AHEAD = 16 * LANES
TINIEST = np.float32(1e-37)  # just above where float32 becomes denormal and arithmetic slow


@inlined
def moved(value, slope, mean, square, rate, beta1, beta2, rest1, rest2, epsilon, square_correction):
    """Give sixteen values and both moments after a step; moments too small for a normal number become 0.

    Args:
        value: sixteen.
        slope: their gradients.
        mean: first moments.
        square: second moments.
        rate: learning rate over the first moment's bias correction.
        beta1: decay of the first moment.
        beta2: decay of the second moment.
        rest1: 1 - beta1, rounded once: from the rounded 0.999 it would be off by 5e-5.
        rest2: 1 - beta2, likewise.
        epsilon: beside the root of the second moment.
        square_correction: one over the root of the second moment's bias correction.
    """
    m = fma(splat(beta1), mean, slope * rest1)
    s = fma(splat(beta2), square, slope * slope * rest2)
    m = select(absolute(m) > TINIEST, m, zeros())
    s = select(s > TINIEST, s, zeros())
    length = fma(square_root(s), splat(square_correction), splat(epsilon))
    return value - m * rate / length, m, s


@inlined
def step_values(
    value, gradient, mean, square, start, stop, slopes, rate, beta1, beta2, rest1, rest2, epsilon, square_correction
):
    """Step the values `start` to `stop`; all arrays are flat float32, gradients begin at `slopes`; else as `moved`."""
    ahead, whole = slopes - start, start + (stop - start) // LANES * LANES
    for at in range(start, whole, LANES):  # without a look at how many there are, which takes half as long again
        prefetch_to_write(value, at + AHEAD)
        prefetch_to_write(mean, at + AHEAD)
        prefetch_to_write(square, at + AHEAD)
        v, m, s = moved(
            load(value, at), load(gradient, at + ahead), load(mean, at), load(square, at),
            rate, beta1, beta2, rest1, rest2, epsilon, square_correction,
        )  # fmt: skip
        store(value, at, v)
        store(mean, at, m)
        store(square, at, s)
    if whole < stop:
        count = stop - whole
        v, m, s = moved(
            load_first(value, whole, count), load_first(gradient, whole + ahead, count), load_first(mean, whole, count),
            load_first(square, whole, count), rate, beta1, beta2, rest1, rest2, epsilon, square_correction,
        )  # fmt: skip
        store_first(value, whole, count, v)
        store_first(mean, whole, count, m)
        store_first(square, whole, count, s)


@kernel
def step_range(
    start, stop, widths, values, gradients, means, squares, rates, correction, beta1, beta2, rest1, rest2, epsilon, square_correction
):  # fmt: skip
    """Step the rows `start` to `stop` of several arrays, all flat; arrays, widths and rates are tuples; else as `moved`.

    Its rate is one of `rates` over `correction`, that of the first moment's bias.
    """
    for k in range(len(widths)):
        first, last = widths[k] * start, widths[k] * stop
        step_values(
            values[k], gradients[k], means[k], squares[k], first, last, first, F(rates[k] / correction),
            beta1, beta2, rest1, rest2, epsilon, square_correction,
        )  # fmt: skip


@kernel
def step_one_row(row, rows, packed, slopes, rates, correction, beta1, beta2, rest1, rest2, epsilon, square_correction):
    """Step all `rows` of several arrays, of which one has gradients, `slopes`.

    Widths, values, both moments, and zeros for the gradients of any array, are `packed`.
    """
    widths, values, means, squares, gradient = unpacked(packed)
    for k in range(len(widths)):
        value, mean, square, rate, own, width = (
            values[k],
            means[k],
            squares[k],
            F(rates[k] / correction),
            slopes[k],
            widths[k],
        )
        gradient[width * row : width * (row + 1)] = own
        step_values(
            value, gradient, mean, square, 0, width * rows, 0, rate, beta1, beta2, rest1, rest2, epsilon, square_correction
        )  # fmt: skip
        gradient[width * row : width * (row + 1)] = F(0)


@kernel
def harmonics_range(
    start, stop, degree, means, centres, cuts, value, mean, square, rate, beta1, beta2, rest1, rest2, epsilon, square_correction
):  # fmt: skip
    """Step the harmonics of degree 1 and up of the Gaussians `start` to `stop`, whose gradients are never written to memory.

    Coefficients beyond `degree` have no gradient and stay, if they never had one.

    Args:
        start: first row.
        stop: end of the range.
        degree: of the harmonics in use, 1 to 3.
        means: (n, 3) world, metres.
        centres: (3,) of the camera of each view.
        cuts: (n, 3) gradient by the colours of each view.
        value: (n, k, 3) changed, as are the next two.
        mean: (n, k, 3) first moment.
        square: (n, k, 3) second moment.
        rate: as of `moved`, as are the others.
        beta1: see there.
        beta2: see there.
        rest1: see there.
        rest2: see there.
        epsilon: see there.
        square_correction: see there.
    """
    slopes, more = np.empty(LANES * NUMBERS, np.float32), np.empty(LANES * NUMBERS, np.float32)
    means, pitch = means.reshape(means.size), 3 * value.shape[1]
    value, mean, square = value.reshape(value.size), mean.reshape(mean.size), square.reshape(square.size)
    for row in range(start, stop, LANES):
        count = min(stop - row, LANES)
        rest_gradients(means, cuts[0].reshape(cuts[0].size), row, count, centres[0], degree, slopes)
        for view in range(1, len(centres)):
            rest_gradients(means, cuts[view].reshape(cuts[view].size), row, count, centres[view], degree, more)
            for k in range(0, LANES * NUMBERS, LANES):
                store(slopes, k, load(slopes, k) + load(more, k))
        if pitch < NUMBERS:
            for g in range(count):
                for k in range(pitch):
                    slopes[pitch * g + k] = slopes[NUMBERS * g + k]
        step_values(
            value, slopes, mean, square, pitch * row, pitch * (row + count), 0,
            rate, beta1, beta2, rest1, rest2, epsilon, square_correction,
        )  # fmt: skip


@kernel
def step_in_turns(turns, bounds, by_rest, by_plain, degree, harmonics, plain, paces):
    """Take a step with the Gaussians, range after range.

    Args:
        turns: one row of `turns.new_turns`.
        bounds: (a + 1,) of the ranges, jobs of threads.
        by_rest: what `step_gaussians` wants after a range, as are the others.
        by_plain: see there.
        degree: see there.
        harmonics: see there.
        plain: see there.
        paces: see there.
    """
    job = take_turn(turns)
    while job < len(bounds) - 1:
        step_gaussians(bounds[job], bounds[job + 1], by_rest, by_plain, degree, harmonics, plain, paces)
        job = take_turn(turns)


@kernel
def step_gaussians(start, stop, by_rest, by_plain, degree, harmonics, plain, paces):
    """Step the Gaussians `start` to `stop`.

    Args:
        start: first row.
        stop: end of the range.
        by_rest: whether harmonics of degree 1 and up have gradients.
        by_plain: whether any other attribute has.
        degree: of the harmonics in use.
        harmonics: what `harmonics_range` wants after that.
        plain: packed, what `step_range` wants after the rows.
        paces: what it wants then.
    """
    if by_rest:
        harmonics_range(start, stop, degree, *harmonics)
    if by_plain:
        step_range(start, stop, *unpacked(plain), *paces)
