"""From the parameters of Gaussians to splats in the world as one camera sees them.

`sacha_core.animation.kernels.carry` does the same in any dtype and without activations; here the parameters change at every step, and what
takes time is to bring them to the processor: a block of Gaussians is placed, coloured and measured before the next is looked at.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    every,
    floor,
    fma,
    inlined,
    load_first,
    maximum,
    minimum,
    power_of_two,
    prefetch,
    prefetch_to_write,
    select,
    splat,
    square_root,
    store_first,
    zeros,
)
from sacha_core.parallel.kernels.rows import load_at, load_columns, load_rows, store_columns
from sacha_core.raster.kernels.bounds import reach
from sacha_core.raster.kernels.harmonics import harmonic_colours
from sacha_core.raster.splats import LARGEST_COLOUR

F = np.float32
BLOCK = 1024  # Gaussians that stay in the second cache; what is read ahead of a block's end is little beside it
AHEAD = 4 * LANES  # rows
SMALLEST_NORM = F(1e-12)  # of a quaternion, as `geometry.quaternion` has it
LOG2_E = F(np.log2(np.e))
LN_2_HIGH = F(0.693359375)  # has few bits: products with small whole numbers are exact
LN_2_LOW = F(np.log(2) - 0.693359375)
SERIES = tuple(F(1 / k) for k in (5040, 720, 120, 24, 6, 2, 1, 1))
LARGEST, SMALLEST = F(88.72283), F(-87.0)  # beyond, e^x is infinite; e^x is taken for 0


@inlined
def exponential(x):
    """Give e^x, to about one rounding."""
    whole = maximum(minimum(floor(fma(x, splat(LOG2_E), splat(F(0.5)))), splat(F(128))), splat(F(-125)))
    rest = fma(whole, splat(-LN_2_LOW), fma(whole, splat(-LN_2_HIGH), x))
    series = fma(splat(SERIES[0]), rest, splat(SERIES[1]))
    series = fma(series, rest, splat(SERIES[2]))
    series = fma(series, rest, splat(SERIES[3]))
    series = fma(series, rest, splat(SERIES[4]))
    series = fma(series, rest, splat(SERIES[5]))
    series = fma(series, rest, splat(SERIES[6]))
    series = fma(series, rest, splat(SERIES[7]))
    value = series * F(2) * power_of_two(whole - F(1))
    return select(x > LARGEST, splat(F(np.inf)), select(x < SMALLEST, zeros(), value))


@inlined
def logistic(x):
    """Give 1 / (1 + e^-x)."""
    return F(1) / (F(1) + exponential(-x))


@inlined
def turned_along(frame, own):
    """Give the products of the frames' quaternions and the Gaussians' own, brought to unit length."""
    aw, ax, ay, az = frame
    w, x, y, z = own
    norm = maximum(square_root(fma(w, w, fma(x, x, fma(y, y, z * z)))), splat(SMALLEST_NORM))
    inverse = F(1) / norm
    w, x, y, z = w * inverse, x * inverse, y * inverse, z * inverse
    return (
        fma(aw, w, -fma(ax, x, fma(ay, y, az * z))),
        fma(aw, x, fma(ax, w, ay * z)) - az * y,
        fma(aw, y, fma(ay, w, az * x)) - ax * z,
        fma(aw, z, fma(az, w, ax * y)) - ay * x,
    )


@kernel
def carry_splats(
    start, stop, position, log_scale, quaternion, opacity_logit, sensitivity_logit, alive, binding,
    f_rotation, f_scale, f_origin, f_quaternion, means, scales, turned, opacities, colours,
):  # fmt: skip
    """Carry the Gaussians `start` to `stop` along with their triangles, and activate them. All arrays are flat.

    Args:
        start: first row.
        stop: end of the range.
        position: (n, 3) in units of the triangle.
        log_scale: (n, 3) likewise. A Gaussian without end is culled when it is drawn.
        quaternion: (n, 4) of any length.
        opacity_logit: (n,).
        sensitivity_logit: (n,).
        alive: (n,) factors of the opacities; empty for none.
        binding: (n,) triangle of each.
        f_rotation: (f, 3, 3) of the frames, like the next three.
        f_scale: (f,).
        f_origin: (f, 3).
        f_quaternion: (f, 4).
        means: (n, 3) out, world.
        scales: (n, 3) out, metres.
        turned: (n, 4) out, of unit length.
        opacities: (n,) out.
        colours: (n, 4), of which the last is the sensitivity, out; the others stay as they are.
    """
    for row in range(start, stop, LANES):
        count, ahead = stop - row, row + AHEAD
        for line in range(0, 3 * LANES, LANES):  # more streams than the processor foresees
            prefetch(position, 3 * ahead + line)
            prefetch(log_scale, 3 * ahead + line)
            prefetch_to_write(means, 3 * ahead + line)
            prefetch_to_write(scales, 3 * ahead + line)
        for line in range(0, 4 * LANES, LANES):
            prefetch(quaternion, 4 * ahead + line)
            prefetch_to_write(turned, 4 * ahead + line)
            prefetch_to_write(colours, 4 * ahead + line)
        unit, r = load_at(f_scale, binding, row, count), load_rows(f_rotation, binding, row, count, 9, 1)
        ox, oy, oz = load_rows(f_origin, binding, row, count, 3, 1)
        x, y, z = load_columns(position, 3 * row, 3, count)
        x, y, z = x * unit, y * unit, z * unit
        store_columns(means, 3 * row, 3, count, (
            fma(r[0], x, fma(r[1], y, fma(r[2], z, ox))),
            fma(r[3], x, fma(r[4], y, fma(r[5], z, oy))),
            fma(r[6], x, fma(r[7], y, fma(r[8], z, oz))),
        ))  # fmt: skip
        x, y, z = load_columns(log_scale, 3 * row, 3, count)
        store_columns(scales, 3 * row, 3, count, (exponential(x) * unit, exponential(y) * unit, exponential(z) * unit))
        frame = load_rows(f_quaternion, binding, row, count, 4, 1)
        store_columns(turned, 4 * row, 4, count, turned_along(frame, load_columns(quaternion, 4 * row, 4, count)))
        opacity = logistic(load_first(opacity_logit, row, count))
        if len(alive) > 0:
            opacity = opacity * load_first(alive, row, count)
        store_first(opacities, row, count, opacity)
        red, green, blue, _ = load_columns(colours, 4 * row, 4, count)
        sensitivity = logistic(load_first(sensitivity_logit, row, count))
        store_columns(colours, 4 * row, 4, count, (red, green, blue, sensitivity))


@inlined
def drawable(colours, start, stop):
    """Tell whether the numbers `start` to `stop` of flat colours are finite, and none too large to be drawn."""
    fine = zeros() <= zeros()
    for at in range(start, stop, LANES):
        fine = fine & (absolute(load_first(colours, at, stop - at)) < LARGEST_COLOUR)
    return every(fine)


@kernel
def place(start, stop, to_carry, carrying, colouring, to_colour, means, scales, opacities, view):
    """Place the Gaussians `start` to `stop`, and colour them.

    Args:
        start: first row.
        stop: end of the range.
        to_carry: whether they are not in the world yet.
        carrying: what `carry_splats` wants after the rows.
        colouring: what `harmonic_colours` wants after the rows.
        to_colour: whether it is called at all.
        means: (n, 3) world, as are the next two.
        scales: (n, 3).
        opacities: (n,).
        view: parameters of the camera.

    Returns:
        The box in the image that they reach, as `reach` gives it; and whether all their colours can be drawn.
    """
    infinite, fine = F(np.inf), True
    sides = infinite, infinite, -infinite, -infinite
    for block in range(start, stop, BLOCK):
        end = min(block + BLOCK, stop)
        if to_carry:
            carry_splats(block, end, *carrying)
        if to_colour:
            harmonic_colours(block, end, *colouring)
        fine &= drawable(carrying[-1], 4 * block, 4 * end)
        left, top, right, bottom = reach(block, end, means, scales, opacities, view)
        sides = min(sides[0], left), min(sides[1], top), max(sides[2], right), max(sides[3], bottom)
    return sides, fine
