"""Binary cross-entropy's gradient over one band of rows."""

from __future__ import annotations

import numpy as np
from numba import njit

LOWEST = np.float32(1e-6)
HIGHEST = np.float32(1 - 1e-6)


@njit(cache=True, nogil=True)
def entropy_band(predicted, target, top, bottom, weight, gradient, clamped):
    """Clamp the prediction, and write the gradient of `weight` times the summed cross-entropy; zero where the clamp acts.

    Args:
        predicted: (h, w) float32.
        target: (h, w) uint8, 255 stands for 1.
        top: first row.
        bottom: one past the last row.
        weight: float32.
        gradient: (h, w) out.
        clamped: (h, w) out, the prediction inside [1e-6, 1 - 1e-6].
    """
    width = target.shape[1]
    unit = np.float32(1 / 255)
    one = np.float32(1)
    for row in range(top, bottom):
        for x in range(width):
            value = predicted[row, x]
            inside = min(max(value, LOWEST), HIGHEST)
            wanted = np.float32(target[row, x]) * unit
            slope = weight * (inside - wanted) / (inside * (one - inside))
            gradient[row, x] = slope if value == inside else np.float32(0)
            clamped[row, x] = inside
