"""Sums over neighbours, compiled: the same bits as the array operations of `order` and `turning`, in one walk over memory."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["add_orientations", "mean_rows"]


@kernel
def mean_rows(values, rows, trust, bits, out):
    """Mean of rows of `values` (n, c) by trust (p, k), which adds up to 2^bits, halves up, into `out` (p, c)."""
    n_components = values.shape[1]
    half = (1 << bits) >> 1
    for i in range(rows.shape[0]):
        for c in range(n_components):
            out[i, c] = half
        for j in range(rows.shape[1]):
            share = trust[i, j]
            if share:
                row = rows[i, j]
                for c in range(n_components):
                    out[i, c] += values[row, c] * share
        for c in range(n_components):
            out[i, c] >>= bits


@kernel
def add_orientations(known, rows, trust, weight, total):
    """Add to `total` (4, p) the known (4, n) orientations at rows (p, k), each as that of its eight quaternions nearest to the sum."""
    for i in range(rows.shape[0]):
        s, t, u, v = total[0, i], total[1, i], total[2, i], total[3, i]
        for j in range(rows.shape[1]):
            row = rows[i, j]
            share = float(weight * trust[i, j])
            w, x, y, z = known[0, row], known[1, row], known[2, row], known[3, row]
            best = ((w * s + x * t) + y * u) + z * v
            a, b, c, d = w, x, y, z
            dot = ((-x * s + w * t) + z * u) + -y * v
            if abs(dot) > abs(best):
                best, a, b, c, d = dot, -x, w, z, -y
            dot = ((-y * s + -z * t) + w * u) + x * v
            if abs(dot) > abs(best):
                best, a, b, c, d = dot, -y, -z, w, x
            dot = ((-z * s + y * t) + -x * u) + w * v
            if abs(dot) > abs(best):
                best, a, b, c, d = dot, -z, y, -x, w
            if best < 0:
                a, b, c, d = -a, -b, -c, -d
            s, t, u, v = s + a * share, t + b * share, u + c * share, v + d * share
        total[0, i], total[1, i], total[2, i], total[3, i] = s, t, u, v
