"""SSIM with its analytic gradient, and the absolute difference, over one band of rows.

Two stages with a barrier between them. The first blurs the four quantities that SSIM is made of and leaves, for every window, the
derivatives of SSIM with respect to them; the second blurs those derivatives back onto the pixels. Windows are zero padded.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

RADIUS = 5  # 11 x 11 window
C1 = np.float32(0.01**2)
C2 = np.float32(0.03**2)

_taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
_taps /= math.fsum(_taps)
W0, W1, W2, W3, W4, W5 = (np.float32(tap) for tap in _taps[: RADIUS + 1])

# Loops touch few arrays each: with more, the compiler gives up proving that they do not overlap, and runs them one number at a time.
FAST = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, fastmath=FAST)
def _blur_along(line, out):
    """Blur a padded row: ten numbers longer than `out`. The window is symmetric, so six products do for eleven taps."""
    for x in range(len(out)):
        out[x] = (
            W0 * (line[x] + line[x + 10])
            + W1 * (line[x + 1] + line[x + 9])
            + W2 * (line[x + 2] + line[x + 8])
            + W3 * (line[x + 3] + line[x + 7])
            + W4 * (line[x + 4] + line[x + 6])
            + W5 * line[x + 5]
        )


@njit(cache=True, nogil=True, fastmath=FAST)
def _blur_across(rows, out):
    """Blur eleven rows into the one at their middle."""
    for x in range(len(out)):
        out[x] = (
            W0 * (rows[0, x] + rows[10, x])
            + W1 * (rows[1, x] + rows[9, x])
            + W2 * (rows[2, x] + rows[8, x])
            + W3 * (rows[3, x] + rows[7, x])
            + W4 * (rows[4, x] + rows[6, x])
            + W5 * rows[5, x]
        )


@njit(cache=True, nogil=True, fastmath=FAST)
def _products(image_row, target_row, unit, lines):
    """Write both rows, the sum of their squares and their product into the padded `lines`."""
    for x in range(len(target_row)):
        a = image_row[x]
        b = np.float32(target_row[x]) * unit
        lines[0, x + RADIUS] = a
        lines[1, x + RADIUS] = b
        lines[2, x + RADIUS] = a * a + b * b
        lines[3, x + RADIUS] = a * b


@njit(cache=True, nogil=True, fastmath=FAST)
def _similarity(means, d_mean, d_square, d_cross):
    """Write the derivatives of one row of windows, and give its sum of 1 - SSIM."""
    two = np.float32(2)
    one = np.float32(1)
    lost = np.float32(0)  # near 0 where images agree, so that the float32 sum of a row loses nothing
    for x in range(len(d_mean)):
        mean_x = means[0, x]
        mean_y = means[1, x]
        a1 = two * mean_x * mean_y + C1
        a2 = two * (means[3, x] - mean_x * mean_y) + C2
        power = mean_x * mean_x + mean_y * mean_y
        b1 = power + C1
        b2 = means[2, x] - power + C2
        inverse = one / (b1 * b2)
        ssim = a1 * a2 * inverse
        by_cross = two * a1 * inverse
        by_square = -ssim * b1 * inverse
        by_mean = two * mean_y * a2 * inverse - two * mean_x * ssim * b2 * inverse
        d_mean[x] = by_mean - mean_y * by_cross - two * mean_x * by_square
        d_square[x] = by_square
        d_cross[x] = by_cross
        lost += one - ssim
    return lost


@njit(cache=True, nogil=True, fastmath=FAST)
def ssim_band(image, target, unit, top, bottom, d_mean, d_square, d_cross, sums):
    """Write SSIM's derivatives for the windows centred on rows top to bottom, and sum 1 - SSIM.

    Args:
        image: (c, h, w) float32; channels beyond the target's are left alone.
        target: (c', h, w) of any number type.
        unit: float32 that turns a value of `target` into [0, 1].
        top: first row.
        bottom: one past the last row.
        d_mean: (c', h, w) out, by the blurred image.
        d_square: (c', h, w) out, by the blurred sum of both squares.
        d_cross: (c', h, w) out, by the blurred product.
        sums: (1,) float64 out, 1 - SSIM summed over the band.
    """
    channels, height, width = target.shape
    rows = bottom - top + 2 * RADIUS
    blurred = np.zeros((4, rows, width), np.float32)
    lines = np.zeros((4, width + 2 * RADIUS), np.float32)
    means = np.empty((4, width), np.float32)
    total = 0.0
    for channel in range(channels):
        for row in range(rows):
            source = top - RADIUS + row
            if source < 0 or source >= height:
                blurred[:, row] = 0
                continue
            _products(image[channel, source], target[channel, source], unit, lines)
            for quantity in range(4):
                _blur_along(lines[quantity], blurred[quantity, row])
        for row in range(bottom - top):
            for quantity in range(4):
                _blur_across(blurred[quantity, row : row + 11], means[quantity])
            at = top + row
            total += _similarity(means, d_mean[channel, at], d_square[channel, at], d_cross[channel, at])
    sums[0] = total


@njit(cache=True, nogil=True, fastmath=FAST)
def _assemble(image_row, target_row, unit, back, ssim_weight, l1_weight, out):
    """Write one row of the gradient from the blurred derivatives, and give its sum of |I - G|."""
    two = np.float32(2)
    total = np.float32(0)
    for x in range(len(target_row)):
        a = image_row[x]
        b = np.float32(target_row[x]) * unit
        difference = a - b
        total += abs(difference)
        sign = np.float32(difference > 0) - np.float32(difference < 0)
        out[x] = ssim_weight * (back[0, x] + two * a * back[1, x] + b * back[2, x]) + l1_weight * sign
    return total


@njit(cache=True, nogil=True, fastmath=FAST)
def gradient_band(image, target, unit, top, bottom, d_mean, d_square, d_cross, ssim_weight, l1_weight, gradient, sums):
    """Write the gradient of `l1_weight sum|I - G| + ssim_weight sum SSIM` at rows top to bottom, and sum |I - G|.

    Args:
        image: (c, h, w) float32.
        target: (c', h, w) of any number type.
        unit: float32 that turns a value of `target` into [0, 1].
        top: first row.
        bottom: one past the last row.
        d_mean: (c', h, w) as `ssim_band` left it, like the next two.
        d_square: see `d_mean`.
        d_cross: see `d_mean`.
        ssim_weight: float32.
        l1_weight: float32.
        gradient: (c, h, w) out; channels beyond the target's are left alone.
        sums: (1,) float64 out, |I - G| summed over the band.
    """
    channels, height, width = target.shape
    rows = bottom - top + 2 * RADIUS
    blurred = np.zeros((3, rows, width), np.float32)
    line = np.zeros(width + 2 * RADIUS, np.float32)
    back = np.empty((3, width), np.float32)
    total = 0.0
    for channel in range(channels):
        derivatives = (d_mean[channel], d_square[channel], d_cross[channel])
        for quantity in range(3):
            for row in range(rows):
                source = top - RADIUS + row
                if source < 0 or source >= height:
                    blurred[quantity, row] = 0
                    continue
                line[RADIUS : RADIUS + width] = derivatives[quantity][source]
                _blur_along(line, blurred[quantity, row])
        for row in range(bottom - top):
            for quantity in range(3):
                _blur_across(blurred[quantity, row : row + 11], back[quantity])
            at = top + row
            out = gradient[channel, at]
            total += _assemble(image[channel, at], target[channel, at], unit, back, ssim_weight, l1_weight, out)
    sums[0] = total
