"""Real spherical harmonics of degree 0 to 3, of sixteen Gaussians at a time.

Coefficients lie as files and the optimiser have them: those of a Gaussian together, three colours each. What takes time is to read them, so
rows that cannot matter (of a lower degree, or without gradient) are not read; the others are turned into columns of lanes in registers.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    fma,
    inlined,
    load_first,
    maximum,
    minimum,
    prefetch,
    prefetch_to_write,
    select,
    some,
    splat,
    square_root,
    zeros,
)
from sacha_core.parallel.kernels.rows import first_lanes, load_columns, load_wide, store_columns, store_products

F = np.float32
# constants of the basis, in the order of the coefficients
BASIS = (
    0.28209479177387814,
    -0.4886025119029199, 0.4886025119029199, -0.4886025119029199,
    1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396,
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658, 1.445305721320277,
    -0.5900435899266435,
)  # fmt: skip
AHEAD = 2 * LANES  # rows; the processor does not foresee rows that are read in three goes
FAR_AHEAD = 4 * LANES  # rows, where each takes little to do
COEFFICIENTS = 15  # of degree 1 to 3
NUMBERS = 3 * COEFFICIENTS


@inlined
def directions(means, at, count, centre):
    """Give unit vectors from the camera to `count` means, and inverse distances; straight ahead and 0 where there is none."""
    x, y, z = load_columns(means, at, 3, count)
    x, y, z = x - centre[0], y - centre[1], z - centre[2]
    square = fma(x, x, fma(y, y, z * z))
    known = (square > F(0)) & (square < F(np.inf))
    inverse = select(known, F(1) / square_root(square), zeros())
    return (
        select(known, x * inverse, zeros()),
        select(known, y * inverse, zeros()),
        select(known, z * inverse, splat(F(1))),
        inverse,
    )


@inlined
def first_degree(x, y, z):
    """Give the three basis functions of degree 1 at unit vectors."""
    return y * BASIS[1], z * BASIS[2], x * BASIS[3]


@inlined
def second_degree(x, y, z):
    """Give the five of degree 2."""
    xx, yy, zz = x * x, y * y, z * z
    return (
        x * y * BASIS[4],
        y * z * BASIS[5],
        (zz + zz - xx - yy) * BASIS[6],
        x * z * BASIS[7],
        (xx - yy) * BASIS[8],
    )


@inlined
def third_degree(x, y, z):
    """Give the seven of degree 3."""
    xx, yy, zz = x * x, y * y, z * z
    ring = F(4) * zz - xx - yy
    return (
        y * (F(3) * xx - yy) * BASIS[9],
        x * y * z * BASIS[10],
        y * ring * BASIS[11],
        z * (F(2) * zz - F(3) * (xx + yy)) * BASIS[12],
        x * ring * BASIS[13],
        z * (xx - yy) * BASIS[14],
        x * (xx - F(3) * yy) * BASIS[15],
    )


@inlined
def third_columns(sh_rest, at, pitch, wanted):
    """Give the coefficients of degree 3 of sixteen rows, `at` being where degree 1 begins: 16 columns and 5."""
    return load_wide(sh_rest, at + 24, pitch, 16, wanted), load_wide(sh_rest, at + 40, pitch, 5, wanted)


@inlined
def prefetch_block(sh_rest, pitch, row, stop, degrees):
    """Ask for the coefficients of the sixteen Gaussians from `row` on, up to the highest of their degrees (lanes).

    All rows, though some may not be needed: lines left out here and there cost more than they save.
    """
    numbers = (
        3 * 15 if some(degrees >= F(3)) else 3 * 8 if some(degrees >= F(2)) else 3 * 3 if some(degrees >= F(1)) else 0
    )
    for g in range(row, min(row + LANES, stop)):
        for k in range(pitch * g, pitch * g + numbers, LANES):
            prefetch(sh_rest, k)
        prefetch(sh_rest, pitch * g + max(numbers - 1, 0))


@inlined
def active(degrees, row, count, degree):
    """Give the degrees of `count` Gaussians, at most `degree` (as lanes), 0 in the lanes beyond; `degrees` may be empty for no limit."""
    if len(degrees) == 0:
        return select(first_lanes(count), degree, zeros())
    return minimum(load_first(degrees, row, count), degree)


@inlined
def first_slope(c, k):
    """Give the gradient of colour k by the vector, each basis function of degree 1 taken as a polynomial of x, y and z."""
    return c[6 + k] * BASIS[3], c[k] * BASIS[1], c[3 + k] * BASIS[2]


@inlined
def second_slope(x, y, z, c, k):
    """Give the same of degree 2."""
    xy, yz = c[k] * BASIS[4], c[3 + k] * BASIS[5]
    zz, xz, xx = c[6 + k] * BASIS[6], c[9 + k] * BASIS[7], c[12 + k] * BASIS[8]
    return (
        fma(xy, y, fma(xz, z, F(2) * x * (xx - zz))),
        fma(xy, x, fma(yz, z, F(-2) * y * (xx + zz))),
        fma(yz, y, fma(xz, x, F(4) * z * zz)),
    )


@inlined
def third_slope(x, y, z, c, d, e, k):
    """Give the same of degree 3, whose last two coefficients of this colour are `d` and `e`."""
    a0, a1, a2 = c[k] * BASIS[9], c[3 + k] * BASIS[10], c[6 + k] * BASIS[11]
    a3, a4, a5, a6 = c[9 + k] * BASIS[12], c[12 + k] * BASIS[13], d * BASIS[14], e * BASIS[15]
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    across = F(3) * (xx - yy)
    return (
        F(6) * xy * a0 + yz * a1 - F(2) * xy * a2 - F(6) * xz * a3 + (F(4) * zz - F(3) * xx - yy) * a4 + F(2) * xz * a5 + across * a6,
        across * a0 + xz * a1 + (F(4) * zz - xx - F(3) * yy) * a2 - F(6) * yz * a3 - F(2) * xy * a4 - F(2) * yz * a5 - F(6) * xy * a6,
        xy * a1 + F(8) * yz * a2 + (F(6) * zz - F(3) * (xx + yy)) * a3 + F(8) * xz * a4 + (xx - yy) * a5,
    )  # fmt: skip


@inlined
def add(a, b):
    """Give the sum of two triples."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def store_tilt(tilts, at, count, place, slope):
    """Write the gradients of a colour of up to sixteen Gaussians by their means, from those by the vector to them."""
    x, y, z, inverse = place
    dx, dy, dz = slope
    radial = fma(x, dx, fma(y, dy, z * dz))
    store_columns(
        tilts, at, 3, count, ((dx - x * radial) * inverse, (dy - y * radial) * inverse, (dz - z * radial) * inverse)
    )


@kernel
def harmonic_colours(  # noqa: PLR0915 - degree after degree, whose coefficients live in registers
    start, stop, sh_dc, sh_rest, means, centre, degree, degrees, colours, tilts
):  # fmt: skip
    """Write max(SH + 0.5, 0) of the Gaussians `start` to `stop`. All arrays are contiguous float32 but `degrees`.

    A broken coefficient gives a broken colour, which the rasteriser notices.

    Args:
        start: first row.
        stop: end of the range.
        sh_dc: (n, 3).
        sh_rest: (n, k, 3) with k of at least (degree + 1)^2 - 1.
        means: (n, 3) world.
        centre: (3,) of the camera.
        degree: 0 to 3; higher coefficients are not looked at.
        degrees: (n,) uint8, of each Gaussian; higher coefficients of it are not looked at either; empty for no such limit.
        colours: (n, 3 or 4) out; a fourth column stays as it is.
        tilts: (3, n, 3) out: the gradient of each colour by the mean, while the coefficients are at hand; empty for nobody to want them.
    """
    pitch, width, plane, tilting = 3 * sh_rest.shape[1], colours.shape[1], 3 * len(means), tilts.size > 0
    tilts = tilts.reshape(tilts.size)
    sh_dc, sh_rest, means = sh_dc.reshape(sh_dc.size), sh_rest.reshape(sh_rest.size), means.reshape(means.size)
    colours = colours.reshape(colours.size)
    highest = splat(F(degree))
    for row in range(start, stop, LANES):
        count = stop - row
        x, y, z, inverse = directions(means, 3 * row, count, centre)
        nothing = zeros()
        by_red, by_green, by_blue = (
            (nothing, nothing, nothing),
            (nothing, nothing, nothing),
            (nothing, nothing, nothing),
        )
        red, green, blue = load_columns(sh_dc, 3 * row, 3, count)
        half, constant = splat(F(0.5)), splat(BASIS[0])
        red, green, blue = fma(red, constant, half), fma(green, constant, half), fma(blue, constant, half)
        level, at = active(degrees, row, count, highest), pitch * row
        prefetch_block(sh_rest, pitch, row + AHEAD, stop, active(degrees, row + AHEAD, stop - row - AHEAD, highest))
        wanted = level >= F(1)
        if some(wanted):
            b = first_degree(x, y, z)
            c = load_wide(sh_rest, at, pitch, 9, wanted)
            red = fma(b[0], c[0], fma(b[1], c[3], fma(b[2], c[6], red)))
            green = fma(b[0], c[1], fma(b[1], c[4], fma(b[2], c[7], green)))
            blue = fma(b[0], c[2], fma(b[1], c[5], fma(b[2], c[8], blue)))
            if tilting:
                by_red, by_green, by_blue = first_slope(c, 0), first_slope(c, 1), first_slope(c, 2)
        wanted = level >= F(2)
        if some(wanted):
            b = second_degree(x, y, z)
            c = load_wide(sh_rest, at + 9, pitch, 15, wanted)
            red = fma(b[0], c[0], fma(b[1], c[3], fma(b[2], c[6], fma(b[3], c[9], fma(b[4], c[12], red)))))
            green = fma(b[0], c[1], fma(b[1], c[4], fma(b[2], c[7], fma(b[3], c[10], fma(b[4], c[13], green)))))
            blue = fma(b[0], c[2], fma(b[1], c[5], fma(b[2], c[8], fma(b[3], c[11], fma(b[4], c[14], blue)))))
            if tilting:
                by_red = add(by_red, second_slope(x, y, z, c, 0))
                by_green = add(by_green, second_slope(x, y, z, c, 1))
                by_blue = add(by_blue, second_slope(x, y, z, c, 2))
        wanted = level >= F(3)
        if some(wanted):
            b = third_degree(x, y, z)
            c, d = third_columns(sh_rest, at, pitch, wanted)
            red = fma(b[0], c[0], fma(b[1], c[3], fma(b[2], c[6], fma(b[3], c[9], fma(b[4], c[12], red)))))
            green = fma(b[0], c[1], fma(b[1], c[4], fma(b[2], c[7], fma(b[3], c[10], fma(b[4], c[13], green)))))
            blue = fma(b[0], c[2], fma(b[1], c[5], fma(b[2], c[8], fma(b[3], c[11], fma(b[4], c[14], blue)))))
            red = fma(b[5], c[15], fma(b[6], d[2], red))
            green = fma(b[5], d[0], fma(b[6], d[3], green))
            blue = fma(b[5], d[1], fma(b[6], d[4], blue))
            if tilting:
                by_red = add(by_red, third_slope(x, y, z, c, c[15], d[2], 0))
                by_green = add(by_green, third_slope(x, y, z, c, d[0], d[3], 1))
                by_blue = add(by_blue, third_slope(x, y, z, c, d[1], d[4], 2))
        if tilting:
            store_tilt(tilts, 3 * row, count, (x, y, z, inverse), by_red)
            store_tilt(tilts, 3 * row + plane, count, (x, y, z, inverse), by_green)
            store_tilt(tilts, 3 * row + 2 * plane, count, (x, y, z, inverse), by_blue)
        columns = (
            maximum(zeros(), red),
            maximum(zeros(), green),
            maximum(zeros(), blue),
        )  # what is not a number stays so
        if width == 4:
            store_columns(colours, 4 * row, 4, count, columns)
        else:
            store_columns(colours, 3 * row, 3, count, columns)


@inlined
def passed_on(colour, slope):
    """Give the gradient where the colour was not cut at 0, 0 elsewhere."""
    return select(colour > F(0), slope, zeros())


@kernel
def harmonic_gradients(start, stop, tilts, colours, gradient, cut, g_means):
    """Carry gradients by the colours of the Gaussians `start` to `stop` back. All arrays are contiguous float32.

    Args:
        start: first row.
        stop: end of the range.
        tilts: (3, n, 3) what `harmonic_colours` gave; empty where colours do not depend on the direction.
        colours: (n, 3 or 4) likewise.
        gradient: (n, 3 or 4) by the colours, as wide; a fourth column is not looked at.
        cut: (n, 3) out: `gradient` where the colour was not cut at 0, 0 elsewhere.
        g_means: (n, 3) added to.
    """
    width, plane = colours.shape[1], 3 * len(colours)
    colours, gradient = colours.reshape(colours.size), gradient.reshape(gradient.size)
    tilts, cut, g_means = tilts.reshape(tilts.size), cut.reshape(cut.size), g_means.reshape(g_means.size)
    for row in range(start, stop, LANES):
        count, ahead = stop - row, row + FAR_AHEAD
        for line in range(0, 3 * LANES, LANES):  # more streams than the processor foresees
            prefetch_to_write(cut, 3 * ahead + line)
            prefetch(tilts, 3 * ahead + line)
            prefetch(tilts, 3 * ahead + line + plane)
            prefetch(tilts, 3 * ahead + line + 2 * plane)
        for line in range(0, width * LANES, LANES):
            prefetch(colours, width * ahead + line)
        if width == 4:
            red, green, blue, _ = load_columns(colours, 4 * row, 4, count)
            g_red, g_green, g_blue, _ = load_columns(gradient, 4 * row, 4, count)
        else:
            red, green, blue = load_columns(colours, 3 * row, 3, count)
            g_red, g_green, g_blue = load_columns(gradient, 3 * row, 3, count)
        red, green, blue = passed_on(red, g_red), passed_on(green, g_green), passed_on(blue, g_blue)
        store_columns(cut, 3 * row, 3, count, (red, green, blue))
        if len(tilts) == 0:
            continue
        size = absolute(red) + absolute(green) + absolute(blue)
        rx, ry, rz = load_columns(tilts, 3 * row, 3, count)
        gx, gy, gz = load_columns(tilts, 3 * row + plane, 3, count)
        bx, by, bz = load_columns(tilts, 3 * row + 2 * plane, 3, count)
        mx, my, mz = load_columns(g_means, 3 * row, 3, count)
        still = size <= F(0)  # whatever its coefficients are; what is not a number does not hide
        mx = select(still, mx, fma(red, rx, fma(green, gx, fma(blue, bx, mx))))
        my = select(still, my, fma(red, ry, fma(green, gy, fma(blue, by, my))))
        mz = select(still, mz, fma(red, rz, fma(green, gz, fma(blue, bz, mz))))
        store_columns(g_means, 3 * row, 3, count, (mx, my, mz))


@inlined
def rest_gradients(means, cut, row, count, centre, degree, gradient):
    """Write the gradients by the coefficients of degree 1 and up of the sixteen Gaussians from `row` on.

    Args:
        means: flat (n, 3).
        cut: flat (n, 3) gradient by the colours, as `harmonic_gradients` gives it.
        row: first Gaussian.
        count: so many of them there are; if more than sixteen, sixteen.
        centre: (3,) of the camera.
        degree: 1 to 3, in use.
        gradient: flat (16, 15, 3) out, zero beyond `degree` and `count`.
    """
    x, y, z, _ = directions(means, 3 * row, count, centre)
    colours = load_columns(cut, 3 * row, 3, count)
    second, third = splat(F(degree > 1)), splat(F(degree > 2))
    a, b, c = first_degree(x, y, z), second_degree(x, y, z), third_degree(x, y, z)
    store_products(gradient, 0, (
        *a, b[0] * second, b[1] * second, b[2] * second, b[3] * second, b[4] * second,
        c[0] * third, c[1] * third, c[2] * third, c[3] * third, c[4] * third, c[5] * third, c[6] * third,
    ), colours)  # fmt: skip


@kernel
def coefficient_gradients(start, stop, means, centre, degree, cut, g_rest):
    """Add the gradients by the coefficients of the Gaussians `start` to `stop` to (n, k, 3), for who wants them in memory."""
    means, cut, numbers = means.reshape(means.size), cut.reshape(cut.size), 3 * g_rest.shape[1]
    g_rest, gradient = g_rest.reshape(g_rest.size), np.empty(LANES * NUMBERS, np.float32)
    for row in range(start, stop, LANES):
        rest_gradients(means, cut, row, stop - row, centre, degree, gradient)
        for g in range(min(LANES, stop - row)):
            for k in range(numbers):
                g_rest[numbers * (row + g) + k] += gradient[NUMBERS * g + k]
