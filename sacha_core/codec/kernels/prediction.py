"""Linear prediction, compiled: the same integers as the array operations of `prediction`.

Source: own.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["learn_values", "predict_values"]


@kernel
def predict_values(values, near, trust, mates, mate_trust, centre, weights, trust_bits, weight_bits, out):
    """Mixture of the means of neighbours and of mates around a centre, into `out` (p, c); weights (2, c) are 0 of what is not there."""
    n_components = values.shape[1]
    half, whole = (1 << trust_bits) >> 1, (1 << weight_bits) >> 1
    by_near, by_mates = np.any(weights[0] != 0), np.any(weights[1] != 0)
    sums = np.empty(n_components, np.int64)
    for i in range(len(out)):
        for c in range(n_components):
            out[i, c] = whole
        if by_near:
            sums[:] = half
            for j in range(near.shape[1]):
                row, share = near[i, j], trust[i, j]
                for c in range(n_components):
                    sums[c] += values[row, c] * share
            for c in range(n_components):
                out[i, c] += ((sums[c] >> trust_bits) - centre[c]) * weights[0, c]
        if by_mates:
            sums[:] = half
            for j in range(mates.shape[1]):
                row, share = mates[i, j], mate_trust[i, j]
                for c in range(n_components):
                    sums[c] += values[row, c] * share
            for c in range(n_components):
                out[i, c] += ((sums[c] >> trust_bits) - centre[c]) * weights[1, c]
        for c in range(n_components):
            out[i, c] = centre[c] + (out[i, c] >> weight_bits)


@kernel
def learn_values(values, rows, predicted, off, across, component, difference, weight_bits):
    """Add the differences of a component to what earlier ones let expect; keep values (n, c) and how far predictions (p, c) were off."""
    whole = (1 << weight_bits) >> 1
    for i in range(len(rows)):
        told = whole
        for before in range(component):
            told += off[i, before] * across[before]
        off[i, component] = (told >> weight_bits) + difference[i]
        values[rows[i], component] = predicted[i, component] + off[i, component]
