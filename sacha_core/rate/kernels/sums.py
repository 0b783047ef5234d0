"""What a view says of the worth of numbers, in one walk over memory.

Source: own.
"""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["add_outer_products", "add_squares", "mirror", "turn_back"]


@kernel
def add_squares(total, values):
    """Add the squares of float32 `values` (n, c) to float64 sums."""
    for i in range(values.shape[0]):
        for c in range(values.shape[1]):
            total[i, c] += values[i, c] * values[i, c]


@kernel
def add_outer_products(total, columns):
    """Add to `total` (n, k, k) the outer products of columns (n, v, k) with themselves, the part on and below the diagonal alone."""
    n, n_views, size = columns.shape
    for i in range(n):
        for view in range(n_views):
            for row in range(size):
                value = columns[i, view, row]
                for column in range(row + 1):
                    total[i, row, column] += value * columns[i, view, column]


@kernel
def mirror(total, factor):
    """Take what lies below the diagonal of `total` (n, k, k) for what lies above, all of it times a factor."""
    size = total.shape[1]
    for i in range(len(total)):
        for row in range(size):
            for column in range(row + 1):
                total[i, row, column] *= factor
                total[i, column, row] = total[i, row, column]


@kernel
def turn_back(slopes, face, rotation, scale, out):
    """Gradients by means in the world (n, 3) as those by means in triangle units, into `out` (n, 3)."""
    for i in range(len(face)):
        f = face[i]
        for c in range(3):
            turned = (
                slopes[i, 0] * rotation[f, 0, c] + slopes[i, 1] * rotation[f, 1, c] + slopes[i, 2] * rotation[f, 2, c]
            )
            out[i, c] = turned * scale[f]
