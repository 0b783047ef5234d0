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
    select,
    splat,
    square_root,
    store,
    store_first,
    zeros,
)
from sacha_core.parallel.kernels.turns import take_turn
from sacha_core.raster.kernels.harmonics import NUMBERS, rest_gradients

F = np.float32
TINIEST = np.float32(1e-37)  # just above where float32 becomes denormal and arithmetic slow


@inlined
def stepped(
    value, gradient, mean, square, at, count, slopes, rate, beta1, beta2, rest1, rest2, epsilon, square_correction
):
    """Step up to sixteen values from `at` on; moments too small for a normal number become 0.

    Args:
        value: flat float32, changed.
        gradient: flat float32.
        mean: flat float32, first moment, changed.
        square: flat float32, second moment, changed.
        at: first value.
        count: so many there are.
        slopes: where their gradients begin.
        rate: learning rate over the first moment's bias correction.
        beta1: decay of the first moment.
        beta2: decay of the second moment.
        rest1: 1 - beta1, rounded once: from the rounded 0.999 it would be off by 5e-5.
        rest2: 1 - beta2, likewise.
        epsilon: beside the root of the second moment.
        square_correction: one over the root of the second moment's bias correction.
    """
    slope = load_first(gradient, slopes, count)
    m = fma(splat(beta1), load_first(mean, at, count), slope * rest1)
    s = fma(splat(beta2), load_first(square, at, count), slope * slope * rest2)
    m = select(absolute(m) > TINIEST, m, zeros())
    s = select(s > TINIEST, s, zeros())
    length = fma(square_root(s), splat(square_correction), splat(epsilon))
    store_first(value, at, count, load_first(value, at, count) - m * rate / length)
    store_first(mean, at, count, m)
    store_first(square, at, count, s)


@kernel
def step_range(
    start, stop, widths, values, gradients, means, squares, rates, beta1, beta2, rest1, rest2, epsilon, square_correction
):  # fmt: skip
    """Step the rows `start` to `stop` of several arrays, all flat; arrays, widths and rates are tuples; else as `stepped`."""
    for k in range(len(widths)):
        value, gradient, mean, square, rate = values[k], gradients[k], means[k], squares[k], rates[k]
        for at in range(widths[k] * start, widths[k] * stop, LANES):
            stepped(
                value,
                gradient,
                mean,
                square,
                at,
                widths[k] * stop - at,
                at,
                rate,
                beta1,
                beta2,
                rest1,
                rest2,
                epsilon,
                square_correction,
            )


@kernel
def step_one_row(
    row, rows, widths, values, slopes, means, squares, rates, beta1, beta2, rest1, rest2, epsilon, square_correction, gradient
):  # fmt: skip
    """Step all `rows` of several arrays, of which one has gradients, `slopes`; `gradient` holds zeros, and will again."""
    for k in range(len(widths)):
        value, mean, square, rate, own, width = values[k], means[k], squares[k], rates[k], slopes[k], widths[k]
        gradient[width * row : width * (row + 1)] = own
        for at in range(0, width * rows, LANES):
            stepped(
                value,
                gradient,
                mean,
                square,
                at,
                width * rows - at,
                at,
                rate,
                beta1,
                beta2,
                rest1,
                rest2,
                epsilon,
                square_correction,
            )
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
        rate: as of `stepped`, as are the others.
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
        for k in range(0, pitch * count, LANES):
            stepped(
                value, slopes, mean, square, pitch * row + k, pitch * count - k, k,
                rate, beta1, beta2, rest1, rest2, epsilon, square_correction,
            )  # fmt: skip


@kernel
def step_in_turns(turns, moves, motion, rest_bounds, degree, harmonics, plain_bounds, plain):
    """Take one step with all that has gradients, in one call of each thread; jobs do not depend on one another.

    Args:
        turns: one row of `turns.new_turns`.
        moves: whether the motion steps.
        motion: what `step_one_row` wants.
        rest_bounds: (a + 1,) bounds of ranges of Gaussians whose harmonics of degree 1 and up step.
        degree: of those, 1 to 3.
        harmonics: what `harmonics_range` wants after that.
        plain_bounds: (b + 1,) likewise, of those whose other attributes step.
        plain: what `step_range` wants after the rows.
    """
    by_rest, by_plain = len(rest_bounds) - 1, len(plain_bounds) - 1
    job = take_turn(turns)
    while job <= by_rest + by_plain:
        if job < by_rest:
            harmonics_range(rest_bounds[job], rest_bounds[job + 1], degree, *harmonics)
        elif job < by_rest + by_plain:
            step_range(plain_bounds[job - by_rest], plain_bounds[job - by_rest + 1], *plain)
        elif moves:
            step_one_row(*motion)
        job = take_turn(turns)
