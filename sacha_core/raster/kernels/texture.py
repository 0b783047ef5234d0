"""Which triangle each texel of a texture shows."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel


@kernel
def cover(uv, labels):
    """Write the index of a triangle to each texel whose centre lies in it; of several the first.

    Args:
        uv: (f, 3, 2) float64, in texels from the top left corner.
        labels: (h, w) int32, -1 where nothing is.
    """
    height, width = labels.shape
    for face in range(len(uv)):
        x0, y0, x1, y1, x2, y2 = uv[face].ravel()
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if not abs(area) > 0:
            continue
        left, right = max(int(np.floor(min(x0, x1, x2))), 0), min(int(np.ceil(max(x0, x1, x2))), width)
        top, bottom = max(int(np.floor(min(y0, y1, y2))), 0), min(int(np.ceil(max(y0, y1, y2))), height)
        for row in range(top, bottom):
            for column in range(left, right):
                x, y = column + 0.5, row + 0.5
                a = ((x1 - x) * (y2 - y) - (x2 - x) * (y1 - y)) / area
                b = ((x2 - x) * (y0 - y) - (x0 - x) * (y2 - y)) / area
                if a >= 0 and b >= 0 and a + b <= 1 and labels[row, column] < 0:
                    labels[row, column] = face


@kernel
def spread(labels, out):
    """Write `labels` (h, w) to `out`, and to texels without one that of a neighbour, of several the first, sides before corners."""
    height, width = labels.shape
    for row in range(height):
        for column in range(width):
            label = labels[row, column]
            if label < 0:
                for corner in range(2):
                    for down in range(-1, 2):
                        for across in range(-1, 2):
                            y, x = row + down, column + across
                            diagonal = down != 0 and across != 0
                            if label < 0 and diagonal == (corner == 1) and 0 <= y < height and 0 <= x < width:
                                label = labels[y, x]
            out[row, column] = label
