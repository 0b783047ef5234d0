"""Neighbours and sums over them, compiled: the same bits as the array operations of `places`, `order` and `turning`."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["add_orientations", "mean_rows", "nearest_places"]

BEFORE, BEHIND = 2, 2  # known places on the curve that are candidates


@kernel
def take_first(found, squared, count, ratio_bits, trust_bits, near, trust):
    """Take the first of `count` sorted places, leaving out one that equals the one before, and share out trust."""
    taken = 0
    total = 0
    for k in range(count):
        if taken < len(near) and (k == 0 or found[k] != found[k - 1]):
            near[taken] = found[k]
            trust[taken] = ((squared[0] + 1) << ratio_bits) // (squared[k] + 1)
            total += trust[taken]
            taken += 1
    left = 1 << trust_bits
    for k in range(taken):
        trust[k] = (trust[k] << trust_bits) // total
        left -= trust[k]
    if taken:
        trust[0] += left


@kernel
def nearest_places(points, beside, known, listed, low, high, asked, ratio_bits, trust_bits, near, trust):
    """Find the known places nearest to those `asked` for, into `near` and `trust` (p, k), which hold zeros.

    `listed` are all known ones, ascending; those before `low` and from `high` on are other ones than the one asked for.
    """
    found = np.empty(BEFORE + BEHIND + beside.shape[1], np.int64)
    squared = np.empty(len(found), np.int64)
    for i in range(len(asked)):
        place = asked[i]
        count = 0
        for k in range(len(found)):
            if k < BEFORE:
                at = low[i] - BEFORE + k
            elif k < BEFORE + BEHIND:
                at = high[i] + k - BEFORE
            else:
                at = 0
            if at < 0 or at >= len(listed):
                continue
            other = listed[at] if k < BEFORE + BEHIND else beside[place, k - BEFORE - BEHIND]
            if k >= BEFORE + BEHIND and (other == place or not known[other]):
                continue
            away = 0
            for axis in range(3):
                apart = points[other, axis] - points[place, axis]
                away += apart * apart
            at = count  # behind those that are as near
            while at > 0 and squared[at - 1] > away:
                squared[at], found[at] = squared[at - 1], found[at - 1]
                at -= 1
            squared[at], found[at] = away, other
            count += 1
        take_first(found, squared, count, ratio_bits, trust_bits, near[i], trust[i])


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
