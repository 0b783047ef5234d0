"""Real spherical harmonics of degree 0 to 3 and their sums, in the dtype of the arrays."""

from __future__ import annotations

import math

from numba import njit

from sacha_core.raster.kernels.lanes import within

# constants of the basis, in the order of the coefficients
BASIS = (
    0.28209479177387814,
    -0.4886025119029199, 0.4886025119029199, -0.4886025119029199,
    1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396,
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658, 1.445305721320277,
    -0.5900435899266435,
)  # fmt: skip


@within
def direction(means, centre, g, basis):
    """Give the unit vector from the camera to a mean, and the inverse distance; straight ahead and 0 where there is none."""
    x, y, z = means[g, 0] - centre[0], means[g, 1] - centre[1], means[g, 2] - centre[2]
    square = x * x + y * y + z * z
    if not 0 < square < math.inf:
        zero = basis[0] - basis[0]  # of the arrays' dtype
        return zero, zero, zero + 1, zero
    inverse = basis.dtype.type(1) / math.sqrt(square)
    return x * inverse, y * inverse, z * inverse, inverse


@within
def evaluate(x, y, z, degree, basis, values):
    """Write the basis functions of degree 1 up to `degree` at a unit vector."""
    if degree > 0:
        values[1], values[2], values[3] = basis[1] * y, basis[2] * z, basis[3] * x
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        values[4], values[5], values[7] = basis[4] * x * y, basis[5] * y * z, basis[7] * x * z
        values[6], values[8] = basis[6] * (zz + zz - xx - yy), basis[8] * (xx - yy)
        if degree > 2:
            ring = 4 * zz - xx - yy
            values[9], values[10], values[11] = (
                basis[9] * y * (3 * xx - yy),
                basis[10] * x * y * z,
                basis[11] * y * ring,
            )
            values[12], values[13] = basis[12] * z * (2 * zz - 3 * xx - 3 * yy), basis[13] * x * ring
            values[14], values[15] = basis[14] * z * (xx - yy), basis[15] * x * (xx - 3 * yy)


@within
def slope(x, y, z, degree, basis, w):
    """Give the gradient by the vector of sum_k w[k] basis_k, each basis function taken as a polynomial of x, y and z."""
    dx, dy, dz = basis[3] * w[3], basis[1] * w[1], basis[2] * w[2]
    if degree > 1:
        a, b, c, d, e = basis[4] * w[4], basis[5] * w[5], basis[6] * w[6], basis[7] * w[7], basis[8] * w[8]
        dx += a * y + d * z + 2 * x * (e - c)
        dy += a * x + b * z - 2 * y * (e + c)
        dz += b * y + d * x + 4 * z * c
    if degree > 2:
        xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
        a, b, c, d = basis[9] * w[9], basis[10] * w[10], basis[11] * w[11], basis[12] * w[12]
        e, f, h = basis[13] * w[13], basis[14] * w[14], basis[15] * w[15]
        dx += (
            6 * xy * a + yz * b - 2 * xy * c - 6 * xz * d + (4 * zz - 3 * xx - yy) * e + 2 * xz * f + 3 * (xx - yy) * h
        )
        dy += (
            3 * (xx - yy) * a + xz * b + (4 * zz - xx - 3 * yy) * c - 6 * yz * d - 2 * xy * e - 2 * yz * f - 6 * xy * h
        )
        dz += xy * b + 8 * yz * c + (6 * zz - 3 * xx - 3 * yy) * d + 8 * xz * e + (xx - yy) * f
    return dx, dy, dz


@within
def series(sh_dc, sh_rest, g, degree, basis, values):
    """Give SH + 0.5 of one Gaussian, red, green and blue."""
    half = basis.dtype.type(0.5)
    red, green, blue = half + basis[0] * sh_dc[g, 0], half + basis[0] * sh_dc[g, 1], half + basis[0] * sh_dc[g, 2]
    for k in range((degree + 1) ** 2 - 1):
        red += values[k + 1] * sh_rest[g, k, 0]
        green += values[k + 1] * sh_rest[g, k, 1]
        blue += values[k + 1] * sh_rest[g, k, 2]
    return red, green, blue


@within
def lit(value):
    """Give max(value, 0); what is not a number stays so, to be noticed."""
    return value - value if value < 0 else value


@njit(cache=True, nogil=True)
def harmonic_colours(sh_dc, sh_rest, means, centre, basis, values, degree, start, stop, colours):
    """Write max(SH + 0.5, 0) of the Gaussians `start` to `stop`; `basis` holds BASIS, and `values` is space of that size."""
    for g in range(start, stop):
        x, y, z, _ = direction(means, centre, g, basis)
        evaluate(x, y, z, degree, basis, values)
        red, green, blue = series(sh_dc, sh_rest, g, degree, basis, values)
        colours[g, 0], colours[g, 1], colours[g, 2] = lit(red), lit(green), lit(blue)


@njit(cache=True, nogil=True)
def harmonic_gradients(
    sh_dc, sh_rest, means, centre, basis, values, weights, degree, start, stop, gradient, g_dc, g_rest, g_means
):
    """Carry gradients by the colours back; where a colour was cut at 0, it passes nothing on.

    Arguments as of `harmonic_colours`; `weights` is space as `values` is. What lies beyond `degree` in `g_rest` is left alone.
    """
    zero = basis[0] - basis[0]  # of the arrays' dtype
    for g in range(start, stop):
        x, y, z, inverse = direction(means, centre, g, basis)
        evaluate(x, y, z, degree, basis, values)
        red, green, blue = series(sh_dc, sh_rest, g, degree, basis, values)
        red = gradient[g, 0] if red > 0 else zero
        green = gradient[g, 1] if green > 0 else zero
        blue = gradient[g, 2] if blue > 0 else zero
        g_dc[g, 0], g_dc[g, 1], g_dc[g, 2] = basis[0] * red, basis[0] * green, basis[0] * blue
        dx, dy, dz = zero, zero, zero
        if degree > 0:
            for k in range((degree + 1) ** 2 - 1):
                value = values[k + 1]
                g_rest[g, k, 0], g_rest[g, k, 1], g_rest[g, k, 2] = value * red, value * green, value * blue
                weights[k + 1] = red * sh_rest[g, k, 0] + green * sh_rest[g, k, 1] + blue * sh_rest[g, k, 2]
            dx, dy, dz = slope(x, y, z, degree, basis, weights)
        radial = x * dx + y * dy + z * dz
        g_means[g, 0] = (dx - x * radial) * inverse
        g_means[g, 1] = (dy - y * radial) * inverse
        g_means[g, 2] = (dz - z * radial) * inverse
