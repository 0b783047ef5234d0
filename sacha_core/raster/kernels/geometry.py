"""Projection of sixteen Gaussians: the parts that the forward and the backward kernel share."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.lanes import (
    exponent,
    fma,
    load_spread,
    load_strided,
    mantissa,
    maximum,
    minimum,
    select,
    splat,
    square_root,
    within,
)
from sacha_core.raster.kernels.layout import (
    DILATION,
    V_FX,
    V_FY,
    V_ROTATION,
    V_TRANSLATION,
    V_X_MAX,
    V_X_MIN,
    V_Y_MAX,
    V_Y_MIN,
)

F = np.float32
LOG2_E = F(1.4426950408889634)
SQRT_2 = F(1.4142135623730951)


@within
def log2(x):
    """Give the base-2 logarithm of positive normal numbers, by the series of artanh((m - 1) / (m + 1)); error below 1e-7."""
    m = mantissa(x)
    large = m > SQRT_2
    m = select(large, m * F(0.5), m)
    whole = select(large, exponent(x) + F(1), exponent(x))
    s = (m - F(1)) / (m + F(1))
    z = s * s
    series = fma(z, splat(F(2 / 9)), splat(F(2 / 7)))
    series = fma(series, z, splat(F(2 / 5)))
    series = fma(series, z, splat(F(2 / 3)))
    series = fma(series, z, splat(F(2)))
    return fma(s * series, splat(LOG2_E), whole)


@within
def to_camera(means, row, view):
    """Give x, y, z of sixteen means in the camera's axes."""
    x, y, z = load_strided(means, 3 * row, 3, 0), load_strided(means, 3 * row, 3, 1), load_strided(means, 3 * row, 3, 2)
    return (
        turned(view, V_ROTATION, x, y, z) + load_spread(view, V_TRANSLATION),
        turned(view, V_ROTATION + 3, x, y, z) + load_spread(view, V_TRANSLATION + 1),
        turned(view, V_ROTATION + 6, x, y, z) + load_spread(view, V_TRANSLATION + 2),
    )


@within
def turned(view, at, x, y, z):
    """Give the dot product of three view parameters, from `at` on, with (x, y, z)."""
    return fma(load_spread(view, at), x, fma(load_spread(view, at + 1), y, load_spread(view, at + 2) * z))


@within
def jacobian(x, y, z, view):
    """Give 1/z, the clamped slopes x/z and y/z, and the four non-zero entries of the projection's Jacobian: 00, 02, 11, 12."""
    inverse = splat(F(1)) / z
    slope_x = minimum(maximum(x * inverse, load_spread(view, V_X_MIN)), load_spread(view, V_X_MAX))
    slope_y = minimum(maximum(y * inverse, load_spread(view, V_Y_MIN)), load_spread(view, V_Y_MAX))
    j00 = load_spread(view, V_FX) * inverse
    j11 = load_spread(view, V_FY) * inverse
    return inverse, slope_x, slope_y, j00, -(j00 * slope_x), j11, -(j11 * slope_y)


@within
def camera_rows(j_diagonal, j_depth, view, at):
    """Give one row of Jacobian times view rotation: j_diagonal W[at] + j_depth W[2]."""
    r, d = V_ROTATION + 3 * at, V_ROTATION + 6
    return (
        fma(j_diagonal, load_spread(view, r), j_depth * load_spread(view, d)),
        fma(j_diagonal, load_spread(view, r + 1), j_depth * load_spread(view, d + 1)),
        fma(j_diagonal, load_spread(view, r + 2), j_depth * load_spread(view, d + 2)),
    )


@within
def rotation_matrix(w, x, y, z):
    """Give the rotation of a unit quaternion, row by row."""
    two = splat(F(2))
    one = splat(F(1))
    x2, y2, z2 = two * x, two * y, two * z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return (
        one - yy - zz, xy - wz, xz + wy,
        xy + wz, one - xx - zz, yz - wx,
        xz - wy, yz + wx, one - xx - yy,
    )  # fmt: skip


@within
def covariance(u0, u1, u2, v0, v1, v2):
    """Give the entries xx, yy, xy of the dilated covariance of a splat with axes (u, v) in pixels, and its determinant.

    The determinant is |u x v|^2 + 0.3 (|u|^2 + |v|^2) + 0.09, which does not cancel for needles as xx yy - xy^2 does.
    """
    plain_xx, plain_yy = dot3(u0, u1, u2, u0, u1, u2), dot3(v0, v1, v2, v0, v1, v2)
    c0, c1, c2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    square = dot3(c0, c1, c2, c0, c1, c2) + F(float(DILATION) * float(DILATION))
    determinant = fma(plain_xx + plain_yy, splat(DILATION), square)
    return plain_xx + DILATION, plain_yy + DILATION, dot3(u0, u1, u2, v0, v1, v2), determinant


@within
def load_quaternions(quaternions, row):
    """Give sixteen quaternions normalised, their squared lengths, and the inverse lengths."""
    w, x = load_strided(quaternions, 4 * row, 4, 0), load_strided(quaternions, 4 * row, 4, 1)
    y, z = load_strided(quaternions, 4 * row, 4, 2), load_strided(quaternions, 4 * row, 4, 3)
    square = fma(w, w, dot3(x, y, z, x, y, z))
    unit = splat(F(1)) / square_root(square)
    return w * unit, x * unit, y * unit, z * unit, square, unit


@within
def dot3(a0, a1, a2, b0, b1, b2):
    """Give the dot product of two triples."""
    return fma(a0, b0, fma(a1, b1, a2 * b2))
