"""What a view says of the worth of numbers, in one walk over memory.

Source: own.
"""

from __future__ import annotations

import math

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import LANES
from sacha_core.raster.kernels.harmonics import BASIS, NUMBERS, harmonic_gradients, rest_gradients

__all__ = ["add_outer_products", "add_view", "mirror"]

F = np.float32


@kernel
def add_view(start, stop, world, frames, found, colours, tilts, spaces, sums, columns, view, centre, degree):
    """Add what a view says of the Gaussians `start` (a multiple of 16) to `stop`: squares of the gradients by what is coded.

    Args:
        start: first row.
        stop: end of the range.
        world: means, scales, unit quaternions, opacities.
        frames: triangle of each Gaussian, and the triangles' rotations and scales.
        found: gradients by means, which are changed, scales, quaternions, opacities and colours.
        colours: (n, 3) as drawn.
        tilts: (3, n, 3) their gradients by the mean.
        spaces: (n, 3) twice, to work in.
        sums: float64, added to: by position in triangle units, log-scale, turn about the own axes, theta = arcsin sqrt opacity, and the
            coefficients of degree 0.
        columns: (n, v, k + 1) out: the weight of the Gaussian's colour in this view times the harmonics.
        view: which of the v it is.
        centre: (3,) of the camera.
        degree: of the harmonics.
    """
    means, scales, quaternions, opacities = world
    face, rotation, unit = frames
    by_mean, by_scale, by_quaternion, by_opacity, by_colour = found
    cut, weights = spaces
    by_place, by_size, by_turn, by_theta, by_dc = sums
    harmonic_gradients(start, stop, tilts, colours, by_colour, cut, by_mean)
    for i in range(start, stop):
        f = face[i]
        for c in range(3):
            turned = (
                by_mean[i, 0] * rotation[f, 0, c]
                + by_mean[i, 1] * rotation[f, 1, c]
                + by_mean[i, 2] * rotation[f, 2, c]
            )
            slope = turned * unit[f]
            by_place[i, c] += slope * slope
            slope = by_scale[i, c] * scales[i, c]
            by_size[i, c] += slope * slope
        w, x, y, z = quaternions[i, 0], quaternions[i, 1], quaternions[i, 2], quaternions[i, 3]
        a, b, c, d = by_quaternion[i, 0], by_quaternion[i, 1], by_quaternion[i, 2], by_quaternion[i, 3]
        # a turn by v about the own axes moves a unit quaternion q by q (0, v / 2)
        slope = (w * b - x * a - y * d + z * c) * F(0.5)
        by_turn[i, 0] += slope * slope
        slope = (w * c - y * a - z * b + x * d) * F(0.5)
        by_turn[i, 1] += slope * slope
        slope = (w * d - z * a - x * c + y * b) * F(0.5)
        by_turn[i, 2] += slope * slope
        slope = by_opacity[i] * (F(2) * math.sqrt(opacities[i] * (F(1) - opacities[i])))
        by_theta[i] += slope * slope
        red, green, blue = by_colour[i, 0], by_colour[i, 1], by_colour[i, 2]
        square = (
            np.float64(red * red) + np.float64(green * green) + np.float64(blue * blue)
        )  # `float` would stay float32
        weight = F(math.sqrt(square / 3))
        weights[i, 0], weights[i, 1], weights[i, 2] = weight, weight, weight
        constant = F(BASIS[0]) * weight
        columns[i, view, 0] = constant
        for c in range(3):
            if colours[i, c] > F(0):
                by_dc[i, c] += constant * constant
    if degree > 0:
        harmonics_times(start, stop, means, weights, centre, degree, columns, view)


@kernel
def harmonics_times(start, stop, means, weights, centre, degree, columns, view):
    """Write the harmonics of degree 1 and up in the direction in which a camera sees each Gaussian, times `weights` (n, 3), all alike."""
    means, weights, gradient = (
        means.reshape(means.size),
        weights.reshape(weights.size),
        np.empty(LANES * NUMBERS, np.float32),
    )
    for row in range(start, stop, LANES):
        count = min(LANES, stop - row)
        rest_gradients(means, weights, row, count, centre, degree, gradient)
        for g in range(count):
            for k in range(1, columns.shape[2]):
                columns[row + g, view, k] = gradient[NUMBERS * g + 3 * (k - 1)]


@kernel
def add_outer_products(start, stop, total, columns):
    """Add to `total` (n, k, k) the outer products of columns (n, v, k) with themselves, the part on and below the diagonal alone."""
    _, n_views, size = columns.shape
    for i in range(start, stop):
        for view in range(n_views):
            for row in range(size):
                value = columns[i, view, row]
                for column in range(row + 1):
                    total[i, row, column] += value * columns[i, view, column]


@kernel
def mirror(start, stop, total, factor):
    """Take what lies below the diagonal of `total` (n, k, k) for what lies above, all of it times a factor."""
    size = total.shape[1]
    for i in range(start, stop):
        for row in range(size):
            for column in range(row + 1):
                total[i, row, column] *= factor
                total[i, column, row] = total[i, row, column]
