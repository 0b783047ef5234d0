"""Gradients of Gaussians on both ends of the way back: what each view adds, and penalties, sigmoids and whether all are finite at the end.

Gaussians come in chunks, whose number does not depend on that of threads.
"""

from __future__ import annotations

import math

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.train.kernels.carry_backward import carry_backward

FAST = {"contract", "nsz", "arcp", "reassoc"}


@kernel(error_model="numpy", fastmath=FAST)
def note_view(
    start, stop, anew, span, g_means_2d, half_width, half_height, part, cut, basis, shares, seen, lengths, g_dc
):
    """Add what one view says of the Gaussians `start` to `stop` to the sums over the views of a step.

    Args:
        start: first row.
        stop: end of the range.
        anew: whether the sums begin with this view.
        span: (n, 2) of the rasteriser; the second number is 0 for what the view does not show.
        g_means_2d: (n, 2) gradient by the mean's place in the image, pixels.
        half_width: of the whole image, pixels, float32.
        half_height: likewise.
        part: float32, of a penalty that one Gaussian in view has.
        cut: (n, 3) gradient by the colour.
        basis: float32, the harmonic of degree 0.
        shares: (n,) float32 sum: that part for those in view.
        seen: (n,) int32 sum: 1 for those in view.
        lengths: (n,) float32 sum: length of the gradient in normalised device units.
        g_dc: (n, 3) sum: gradient by the coefficients of degree 0.
    """
    spans, slopes, colours = span[start:stop], g_means_2d[start:stop], cut[start:stop]
    shares, seen, lengths, g_dc = shares[start:stop], seen[start:stop], lengths[start:stop], g_dc[start:stop]
    if anew:
        shares[:], seen[:], lengths[:], g_dc[:] = np.float32(0), 0, np.float32(0), np.float32(0)
    for i in range(stop - start):
        visible = spans[i, 1] > 0
        shares[i] += part if visible else np.float32(0)
        seen[i] += visible
    for i in range(stop - start):
        x, y = slopes[i, 0] * half_width, slopes[i, 1] * half_height
        lengths[i] += math.sqrt(x * x + y * y)
    flat, out = colours.reshape(colours.size), g_dc.reshape(g_dc.size)
    for i in range(len(flat)):
        out[i] += basis * flat[i]


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def penalise(
    start, stop, position, scales, f_scale, binding, shares, position_limit, scale_limit, position_weight, scale_weight,
    g_position, g_log_scale,
):  # fmt: skip
    """Add the gradients of the penalties on Gaussians that stray from their triangle or swell.

    Args:
        start: first row.
        stop: end of the range.
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

    Returns:
        Both penalties, weighted, in float64.
    """
    zero, one = np.float32(0), np.float32(1)
    strayed, swollen = 0.0, 0.0
    for i in range(start, stop):
        share = shares[i]
        if not share > zero:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        square = x * x + y * y + z * z
        if square > position_limit * position_limit:
            distance = math.sqrt(square)
            weight = position_weight * share
            strayed += weight * (distance - position_limit)
            weight /= distance
            g_position[i, 0] += weight * x
            g_position[i, 1] += weight * y
            g_position[i, 2] += weight * z
        unit = one / f_scale[binding[i]]
        x, y, z = scales[i, 0] * unit, scales[i, 1] * unit, scales[i, 2] * unit
        a, b, c = max(x - scale_limit, zero), max(y - scale_limit, zero), max(z - scale_limit, zero)
        square = a * a + b * b + c * c
        if square > zero:
            length = math.sqrt(square)
            weight = scale_weight * share
            swollen += weight * length
            weight /= length
            g_log_scale[i, 0] += weight * a * x
            g_log_scale[i, 1] += weight * b * y
            g_log_scale[i, 2] += weight * c * z
    return strayed, swollen


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def through_sigmoid(activated, slopes, out):
    """Write the gradient by a logit from that by its sigmoid; all (n,)."""
    for i in range(len(out)):
        out[i] = slopes[i] * activated[i] * (np.float32(1) - activated[i])


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
def sound(values, largest):
    """Tell whether no number of an array's rows is larger than `largest` or none at all."""
    flat, wrong = values.reshape(values.size), 0
    for i in range(len(flat)):
        wrong += not abs(flat[i]) <= largest
    return wrong == 0


@kernel
def settle(
    first, last, faces_of, rows_of, first_row, position, quaternion, binding, means, scales, turned, opacities, colours,
    g_means, g_scales, g_turned, g_opacities, g_sensitivities, vertices, faces, f_rotation, f_scale, f_origin, with_mesh,
    shares, seen, limits, largest, g_dc, g_sensitivity_logit, g_opacity_logit, g_log_scale, g_quaternion, g_position, g_corners, penalties,
):  # fmt: skip
    """Go from the Gaussians in the world to their attributes and to the corners of triangles; arguments as of the parts; further, these.

        first: chunk.
        last: end of the range of chunks.
        faces_of: (chunks + 1,) first triangle of each chunk.
        rows_of: (chunks + 1,) first Gaussian of each chunk.
        colours: (n, 4) of which the last is the sensitivity.
        limits: (4,) limits and weights of `penalise`, in its order.
        largest: that a gradient may be.
        penalties: (chunks, 2) float64 out.

    Returns:
        Whether all gradients are sound.
    """
    good = True
    for chunk in range(first, last):
        start, stop = rows_of[chunk], rows_of[chunk + 1]
        carry_backward(
            faces_of[chunk], faces_of[chunk + 1], first_row, seen, quaternion, means, scales, turned, g_means, g_scales, g_turned,
            vertices, faces, f_rotation, f_scale, f_origin, with_mesh, g_position, g_log_scale, g_quaternion, g_corners,
        )  # fmt: skip
        penalties[chunk] = penalise(
            start, stop, position, scales, f_scale, binding, shares, limits[0], limits[1], limits[2], limits[3], g_position, g_log_scale,
        )  # fmt: skip
        through_sigmoid(opacities[start:stop], g_opacities[start:stop], g_opacity_logit[start:stop])
        through_sigmoid(colours[start:stop, 3], g_sensitivities[start:stop], g_sensitivity_logit[start:stop])
        good &= (
            sound(g_dc[start:stop], largest)
            & sound(g_position[start:stop], largest)
            & sound(g_log_scale[start:stop], largest)
        )
        good &= sound(g_quaternion[start:stop], largest) & sound(g_opacity_logit[start:stop], largest)
        good &= sound(g_sensitivity_logit[start:stop], largest)
    return good
