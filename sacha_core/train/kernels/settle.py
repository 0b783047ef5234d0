"""Gradients of Gaussians on both ends of the way back: what each view adds, and penalties, sigmoids and whether all are finite at the end.

Gaussians come in chunks, whose number does not depend on that of threads.
"""

from __future__ import annotations

import math

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    every,
    fma,
    inlined,
    load_first,
    maximum,
    number,
    prefetch,
    prefetch_to_write,
    select,
    some,
    square_root,
    store,
    store_first,
    zeros,
)
from sacha_core.parallel.kernels.rows import load_at, load_columns, load_rows, store_columns
from sacha_core.train.kernels.carry_backward import (
    PULLS,
    add_pulls,
    corner_slopes,
    dot,
    position_slopes,
    quaternion_slopes,
)

F = np.float32
FAST = {"contract", "nsz", "arcp", "reassoc"}
AHEAD = 4 * LANES  # rows
SCRATCH = PULLS * LANES  # numbers that `settle` works in, and PULLS more for each triangle of a chunk


@kernel(error_model="numpy", fastmath=FAST, forceinline=True)
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
    nothing = np.float32(0)
    for i in range(stop - start):
        visible = spans[i, 1] > 0
        x, y = slopes[i, 0] * half_width, slopes[i, 1] * half_height
        shares[i] = (nothing if anew else shares[i]) + (part if visible else nothing)
        seen[i] = (0 if anew else seen[i]) + visible
        lengths[i] = (nothing if anew else lengths[i]) + math.sqrt(x * x + y * y)
    flat, out = colours.reshape(colours.size), g_dc.reshape(g_dc.size)
    for i in range(len(flat)):
        out[i] = (nothing if anew else out[i]) + basis * flat[i]


@inlined
def penalise_straying(share, limit, weight, own, slopes):
    """Penalise sixteen Gaussians that stray from their triangle; gives the penalties, and the gradients with theirs added.

    Args:
        share: of a penalty that each has; 0 for those that are not in view.
        limit: of |position|, local units.
        weight: of what exceeds it.
        own: positions.
        slopes: gradient by them so far.
    """
    x, y, z = own
    square, nothing = dot(x, y, z, x, y, z), zeros()
    far = (square > limit * limit) & (share > F(0))
    if not some(far):
        return nothing, slopes
    distance = square_root(square)
    weights = select(far, share * weight, nothing)
    factor = weights / distance
    slopes = (
        select(far, fma(factor, x, slopes[0]), slopes[0]),
        select(far, fma(factor, y, slopes[1]), slopes[1]),
        select(far, fma(factor, z, slopes[2]), slopes[2]),
    )
    return select(far, weights * (distance - limit), nothing), slopes


@inlined
def penalise_swelling(share, limit, weight, own, slopes):
    """Penalise those that swell: the length of what standard deviations exceed their limit by; likewise, by their logarithms."""
    x, y, z = own
    nothing = zeros()
    a, b, c = maximum(x - limit, nothing), maximum(y - limit, nothing), maximum(z - limit, nothing)
    square = dot(a, b, c, a, b, c)
    wide = (square > F(0)) & (share > F(0))
    if not some(wide):
        return nothing, slopes
    length = square_root(square)
    weights = select(wide, share * weight, nothing)
    factor = weights / length
    slopes = (
        select(wide, fma(factor * a, x, slopes[0]), slopes[0]),
        select(wide, fma(factor * b, y, slopes[1]), slopes[1]),
        select(wide, fma(factor * c, z, slopes[2]), slopes[2]),
    )
    return select(wide, weights * length, nothing), slopes


@inlined
def through_sigmoid(activated, slope):
    """Give the gradient by a logit from that by its sigmoid."""
    return slope * activated * (F(1) - activated)


@inlined
def sound(x, y, z, largest):
    """Tell where no number of three is larger than `largest`, or none at all."""
    return (absolute(x) <= largest) & (absolute(y) <= largest) & (absolute(z) <= largest)


@kernel
def settle(
    first, last, faces_of, rows_of, position, quaternion, binding, scales, turned, opacities, colours,
    g_means, g_scales, g_turned, g_opacities, g_sensitivities, vertices, faces, f_rotation, f_scale, with_mesh,
    shares, limits, largest, g_dc, g_sensitivity_logit, g_opacity_logit, g_log_scale, g_quaternion, g_position, g_corners,
    penalties, scratch, pulls,
):  # fmt: skip
    """Go from the Gaussians in the world to their attributes and to the corners of triangles. All arrays are flat but `penalties`.

    Args:
        first: chunk.
        last: end of the range of chunks.
        faces_of: (chunks + 1,) first triangle of each chunk.
        rows_of: (chunks + 1,) first Gaussian of each chunk.
        position: (n, 3) own.
        quaternion: (n, 4) own, of any length.
        binding: (n,).
        scales: (n, 3) metres.
        turned: (n, 4) in the world, of unit length.
        opacities: (n,).
        colours: (n, 4) of which the last is the sensitivity.
        g_means: (n, 3) gradient by the means in the world.
        g_scales: (n, 3) by `scales`.
        g_turned: (n, 4) by `turned`.
        g_opacities: (n,).
        g_sensitivities: (n, 4) of which the last is the gradient by the sensitivity.
        vertices: (v, 3) posed.
        faces: (f, 3).
        f_rotation: (f, 3, 3) of the frames.
        f_scale: (f,) metres a local unit.
        with_mesh: whether `g_corners` is wanted.
        shares: (n,) of a penalty that each Gaussian has; 0 where none was in view: then its gradient is 0 whatever its values are, which
            may be infinite.
        limits: (4,) |mean| and standard deviation beyond which penalties begin, local units; weights of what exceeds them.
        largest: that a gradient may be.
        g_dc: (n, 3) in.
        g_sensitivity_logit: (n,) out.
        g_opacity_logit: (n,) out.
        g_log_scale: (n, 3) out.
        g_quaternion: (n, 4) out.
        g_position: (n, 3) out.
        g_corners: (f, 3, 3) out: by the place of each corner.
        penalties: (chunks, 2) float64 out: for straying and swelling, weighted.
        scratch: (SCRATCH,) to work in.
        pulls: (PULLS f,) likewise, f triangles of any chunk.

    Returns:
        Whether all gradients are sound.
    """
    good = zeros() <= zeros()
    for chunk in range(first, last):
        face, end = faces_of[chunk], faces_of[chunk + 1]
        for at in range(0, PULLS * (end - face), LANES):
            store(pulls, at, zeros())
        strayed, swollen = zeros(), zeros()
        start, stop = rows_of[chunk], rows_of[chunk + 1]
        for row in range(start, stop, LANES):
            count = stop - row
            ahead = row + AHEAD
            for line in range(0, 3 * LANES, LANES):  # more streams than the processor foresees
                prefetch(position, 3 * ahead + line)
                prefetch(scales, 3 * ahead + line)
                prefetch(g_scales, 3 * ahead + line)
                prefetch_to_write(g_position, 3 * ahead + line)
                prefetch_to_write(g_log_scale, 3 * ahead + line)
            for line in range(0, 4 * LANES, LANES):
                prefetch(quaternion, 4 * ahead + line)
                prefetch(turned, 4 * ahead + line)
                prefetch(g_turned, 4 * ahead + line)
                prefetch_to_write(g_quaternion, 4 * ahead + line)
            share = load_first(shares, row, count)
            keep = share > F(0)
            own, quaternions = load_columns(position, 3 * row, 3, count), load_columns(quaternion, 4 * row, 4, count)
            unit = load_at(f_scale, binding, row, count)
            by_position = position_slopes(
                keep, unit, load_rows(f_rotation, binding, row, count, 9, 1), load_columns(g_means, 3 * row, 3, count)
            )
            by_quaternion = quaternion_slopes(
                keep, quaternions, load_columns(turned, 4 * row, 4, count), load_columns(g_turned, 4 * row, 4, count)
            )
            sx, sy, sz = load_columns(scales, 3 * row, 3, count)
            hx, hy, hz = load_columns(g_scales, 3 * row, 3, count)
            nothing = zeros()
            by_size = select(keep, hx * sx, nothing), select(keep, hy * sy, nothing), select(keep, hz * sz, nothing)
            if with_mesh:
                add_pulls(
                    keep,
                    row,
                    count,
                    own,
                    quaternions,
                    by_position,
                    by_size,
                    by_quaternion,
                    binding,
                    face,
                    pulls,
                    scratch,
                )
            unit = F(1) / unit
            penalty, by_position = penalise_straying(share, limits[0], limits[2], own, by_position)
            strayed = strayed + penalty
            penalty, by_size = penalise_swelling(
                share, limits[1], limits[3], (sx * unit, sy * unit, sz * unit), by_size
            )
            swollen = swollen + penalty
            by_opacity = through_sigmoid(load_first(opacities, row, count), load_first(g_opacities, row, count))
            by_sensitivity = through_sigmoid(
                load_columns(colours, 4 * row, 4, count)[3], load_columns(g_sensitivities, 4 * row, 4, count)[3]
            )
            store_columns(g_position, 3 * row, 3, count, by_position)
            store_columns(g_log_scale, 3 * row, 3, count, by_size)
            store_columns(g_quaternion, 4 * row, 4, count, by_quaternion)
            store_first(g_opacity_logit, row, count, by_opacity)
            store_first(g_sensitivity_logit, row, count, by_sensitivity)
            dx, dy, dz = load_columns(g_dc, 3 * row, 3, count)
            good = good & sound(dx, dy, dz, largest) & sound(by_position[0], by_position[1], by_position[2], largest)
            good = (
                good
                & sound(by_size[0], by_size[1], by_size[2], largest)
                & sound(by_opacity, by_sensitivity, nothing, largest)
            )
            good = good & sound(by_quaternion[1], by_quaternion[2], by_quaternion[3], largest)
            good = good & sound(by_quaternion[0], nothing, nothing, largest)
        penalties[chunk, 0], penalties[chunk, 1] = total(strayed), total(swollen)
        if with_mesh:
            for at in range(face, end, LANES):
                corner_slopes(at, end - at, face, pulls, vertices, faces, f_rotation, f_scale, g_corners)
    return every(good)


@inlined
def total(lanes):
    """Give the sum of sixteen lanes in float64."""
    result = 0.0
    for lane in range(LANES):
        result += float(number(lanes, lane))
    return result
