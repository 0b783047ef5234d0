"""Gradients of Gaussians that are back from the world: statistics, penalties, sigmoids, and whether all are finite."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FAST = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def note_view(start, stop, span, g_means_2d, half_width, half_height, part, shares, seen, lengths):
    """Add what one view says of the Gaussians `start` to `stop` to the statistics of the step.

    Args:
        start: first row.
        stop: end of the range.
        span: (n, 2) of the rasteriser; the second number is 0 for what the view does not show.
        g_means_2d: (n, 2) gradient by the mean's place in the image, pixels.
        half_width: of the whole image, pixels, float32.
        half_height: likewise.
        part: float32, of a penalty that one Gaussian in view has.
        shares: (n,) float32, added to: that part for those in view.
        seen: (n,) int32, added to: 1 for those in view.
        lengths: (n,) float32, added to: length of the gradient in normalised device units.
    """
    n = stop - start
    spans, slopes = span[start:stop], g_means_2d[start:stop]
    shares, seen, lengths = shares[start:stop], seen[start:stop], lengths[start:stop]
    for i in range(n):
        visible = spans[i, 1] > 0
        x, y = slopes[i, 0] * half_width, slopes[i, 1] * half_height
        lengths[i] += math.sqrt(x * x + y * y)
        shares[i] += part if visible else np.float32(0)
        seen[i] += visible


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def penalise(
    first, last, rows, position, scales, f_scale, binding, shares, position_limit, scale_limit, position_weight, scale_weight,
    g_position, g_log_scale, sums,
):  # fmt: skip
    """Add the gradients of the penalties on Gaussians that stray from their triangle or swell, and sum the penalties.

    Args:
        first: chunk of Gaussians.
        last: end of the range of chunks.
        rows: (chunks + 1,) first row of each.
        position: (n, 3) local.
        scales: (n, 3) metres.
        f_scale: (f,) metres a local unit.
        binding: (n,).
        shares: (n,) of a penalty that each Gaussian has; 0 for those that are not in view.
        position_limit: float32, local units.
        scale_limit: float32, local units.
        position_weight: float32, of what |mean| exceeds its limit by.
        scale_weight: float32, of the length of what standard deviations exceed their limit by.
        g_position: (n, 3) changed.
        g_log_scale: (n, 3) changed.
        sums: (chunks, 2) float64 out, weighted.
    """
    zero = np.float32(0)
    for chunk in range(first, last):
        strayed, swollen = 0.0, 0.0
        for row in range(rows[chunk], rows[chunk + 1]):
            share = shares[row]
            if not share > zero:
                continue
            x, y, z = position[row, 0], position[row, 1], position[row, 2]
            square = x * x + y * y + z * z
            if square > position_limit * position_limit:
                distance = math.sqrt(square)
                weight = position_weight * share
                strayed += weight * (distance - position_limit)
                weight /= distance
                g_position[row, 0] += weight * x
                g_position[row, 1] += weight * y
                g_position[row, 2] += weight * z
            k = f_scale[binding[row]]
            x, y, z = scales[row, 0] / k, scales[row, 1] / k, scales[row, 2] / k
            a, b, c = max(x - scale_limit, zero), max(y - scale_limit, zero), max(z - scale_limit, zero)
            square = a * a + b * b + c * c
            if square > zero:
                length = math.sqrt(square)
                weight = scale_weight * share
                swollen += weight * length
                weight /= length
                g_log_scale[row, 0] += weight * a * x
                g_log_scale[row, 1] += weight * b * y
                g_log_scale[row, 2] += weight * c * z
        sums[chunk, 0], sums[chunk, 1] = strayed, swollen


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def through_sigmoids(
    start, stop, opacities, g_opacities, g_opacity_logit, sensitivities, g_sensitivities, g_sensitivity_logit
):
    """Write the gradients by both logits of the Gaussians `start` to `stop`."""
    one = np.float32(1)
    ins, outs, slopes = opacities[start:stop], g_opacities[start:stop], g_opacity_logit[start:stop]
    for i in range(stop - start):
        slopes[i] = outs[i] * ins[i] * (one - ins[i])
    ins, outs, slopes = sensitivities[start:stop], g_sensitivities[start:stop], g_sensitivity_logit[start:stop]
    for i in range(stop - start):
        slopes[i] = outs[i] * ins[i] * (one - ins[i])


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def sound(values, largest):
    """Tell whether no number of a flat array is larger than `largest` or none at all."""
    wrong = 0
    for i in range(len(values)):
        wrong += not abs(values[i]) <= largest
    return wrong == 0
