r"""L1 and SSIM of one channel with their gradient, in one pass over a strip of columns.

In terms of the sum $s = x + y$ and the difference $d = x - y$ of image and target, with $P, Q$ the squares of their windowed means and
$S, T$ their windowed variances,

$$SSIM = \frac{(P - Q + 2 C_1)(S - T + 2 C_2)}{(P + Q + 2 C_1)(S + T + 2 C_2)}.$$

With the factors of this fraction called $A_1 A_2 / B_1 B_2$, its derivatives by $P, Q, S, T$ are $2 Q k_1$, $-2 (P + 2 C_1) k_1$,
$2 T k_2$ and $-2 (S + 2 C_2) k_2$, where $k_1 = A_2 / B_1^2 B_2$ and $k_2 = A_1 / B_1 B_2^2$. Nothing cancels: where image and target
agree, Q = T = 0, and SSIM is 1 and its slope 0 to the last bit. So windows in which they agree everywhere are not looked at, which is what
a crop of the image is good for, row by row.

A strip is narrow enough for the rows in flight to stay in the nearest caches, and goes down the image four rows at a time: blur s, d, s^2,
d^2 along the rows and keep them in a ring; blur fourteen of its rows into four, which gives four rows of windows and of SSIM's derivatives,
kept in a second ring; some groups of rows later, blur fourteen of those across and along, and write the gradient of four rows. Windows
are zero padded.

Source: Wang et al., Image quality assessment, 2004; the form in s and d and its derivatives: own.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    fma,
    inlined,
    number,
    ramp,
    select,
    splat,
    store,
    store_first,
    sums,
    zeros,
)
from sacha_core.perception.kernels.differences import GROUP, REACH, around, mark
from sacha_core.perception.kernels.pixels import pixels, write
from sacha_core.perception.kernels.window import RADIUS, blur_across, blur_along, blur_moments

F = np.float32
C1 = F(2 * 0.01**2)
C2 = F(2 * 0.03**2)

STRIP = 128  # columns of gradient that a strip has at most
# Window t of a strip is centred on column left - 5 + t, number i of a line is of column left - 16 + i. Pitches are odd multiples of 64
# bytes, so that rows do not meet in one set of the cache.
WINDOWS = STRIP + LANES
LINE = WINDOWS + 3 * LANES
# Row y lies in place y + 5 of a ring, modulo its length, so that the fourteen rows around a group begin at a multiple of four.
RING = 4 * GROUP  # rows: fourteen, and no more are written before they are read
BATCH = 4  # groups that are compared before the gradients of as many are written: each part has the first cache to itself for a while
SLOPE_RING = (BATCH + 4) * GROUP  # rows: those of a batch, and of two groups before and two after
MOMENTS = 4 * WINDOWS  # a row of the first ring: means of s, d, s^2, d^2
SLOPES = 3 * WINDOWS  # a row of the second, derivatives: by the means (s and d together), by s^2, by d^2
AT_SUM = 0
AT_DIFFERENCE = LINE
AT_RING = 2 * LINE
AT_BLURRED = AT_RING + RING * MOMENTS
AT_SLOPES = AT_BLURRED + GROUP * SLOPES
STRIP_SPACE = AT_SLOPES + SLOPE_RING * SLOPES  # float32 that a strip works in


@inlined
def clear(space, start, stop):
    """Write zeros, sixteen at a time."""
    for at in range(start, stop, LANES):
        store(space, at, zeros())


@inlined
def in_ring(first, row, ring, pitch):
    """Give where a row lies in a ring that begins at `first`."""
    return first + (row + RADIUS) % ring * pitch


@inlined
def around_group(first, group, ring, pitch):
    """Give where the fourteen rows around a group lie in a ring: four and four and four and two of them one after the other."""
    row = GROUP * group - RADIUS
    return (
        in_ring(first, row, ring, pitch),
        in_ring(first, row + GROUP, ring, pitch),
        in_ring(first, row + 2 * GROUP, ring, pitch),
        in_ring(first, row + 3 * GROUP, ring, pitch),
    )


@inlined
def blur_row(image, image_at, target, target_at, unit, width, left, begin, end, space, slot):
    """Blur the moments of one row along it into its slot of the ring, for the windows from `begin` to `end`."""
    for x in range(max(left + begin - LANES, 0), min(left + end, width), LANES):
        a, b = pixels(image, image_at + x, target, target_at + x, unit, width - x)
        store(space, AT_SUM + LANES + x - left, a + b)
        store(space, AT_DIFFERENCE + LANES + x - left, a - b)
    for t in range(begin, end, LANES):
        at = t + LANES - RADIUS
        moments = blur_moments(space, AT_SUM + at, AT_DIFFERENCE + at)
        for part in range(4):
            store(space, slot + part * WINDOWS + t, moments[part])


@inlined
def clear_row(space, slot, begin, end):
    """Put a row beyond the image into the ring."""
    for part in range(4):
        at = slot + part * WINDOWS
        clear(space, at + begin, at + end)


@inlined
def similarity(mean_s, mean_d, square_s, square_d):
    """Give half of 1 - SSIM of sixteen windows, and half of SSIM's derivatives by the means, s^2 and d^2."""
    p, q = mean_s * mean_s, mean_d * mean_d
    s, t = square_s - p, square_d - q
    luminance, contrast = p + C1, s + C2
    b1, b2 = luminance + q, contrast + t
    inverse = F(1) / (b1 * b2)
    k1 = (contrast - t) * inverse * (inverse * b2)
    k2 = (luminance - q) * inverse * (inverse * b1)
    by_s, by_d = t * k2, -(contrast * k2)
    by_means = fma(mean_s, q * k1 - by_s, mean_d * (-(luminance * k1) - by_d))
    return fma(luminance, t, contrast * q) * inverse, by_means, by_s, by_d


@inlined
def compare_windows(space, at, out):
    """Compare sixteen windows whose blurred moments are given; keep the derivatives, give half of 1 - SSIM."""
    lost, by_means, by_s, by_d = similarity(at[0], at[1], at[2], at[3])
    store(space, out, by_means)
    store(space, out + WINDOWS, by_s)
    store(space, out + 2 * WINDOWS, by_d)
    return lost


@inlined
def compare_rows(space, group, height, width, left, right, begin, end, lost):
    """Compare the windows of four rows from `begin` to `end`; windows beyond the image have no derivatives."""
    rows = around_group(AT_RING, group, RING, MOMENTS)
    first, last = (
        in_ring(AT_SLOPES, GROUP * group, SLOPE_RING, SLOPES),
        in_ring(AT_SLOPES, GROUP * group + 3, SLOPE_RING, SLOPES),
    )
    lane, nothing = ramp(), zeros()
    owned = F(right - left + RADIUS)  # windows before and after belong to the strips beside
    lost0, lost1, lost2, lost3 = nothing, nothing, nothing, nothing
    for t in range(begin, end, LANES):
        s0, s1, s2, s3 = blur_across(space, rows, t, MOMENTS)
        d0, d1, d2, d3 = blur_across(space, rows, t + WINDOWS, MOMENTS)
        ss0, ss1, ss2, ss3 = blur_across(space, rows, t + 2 * WINDOWS, MOMENTS)
        dd0, dd1, dd2, dd3 = blur_across(space, rows, t + 3 * WINDOWS, MOMENTS)
        place = lane + F(t)
        mine = (place >= F(RADIUS)) & (place < owned)
        out = first + t
        lost0 = lost0 + select(mine, compare_windows(space, (s0, d0, ss0, dd0), out), nothing)
        lost1 = lost1 + select(mine, compare_windows(space, (s1, d1, ss1, dd1), out + SLOPES), nothing)
        lost2 = lost2 + select(mine, compare_windows(space, (s2, d2, ss2, dd2), out + 2 * SLOPES), nothing)
        lost3 = lost3 + select(mine, compare_windows(space, (s3, d3, ss3, dd3), last + t), nothing)
    count = min(height - GROUP * group, GROUP)
    for row in range(GROUP):
        at = first + row * SLOPES if row < GROUP - 1 else last
        bound_slopes(space, at, width, left, begin, end if row < count else 0)
    totals = sums((lost0, lost1, lost2, lost3))
    for row in range(count):
        lost[GROUP * group + row] = number(totals, row)


@inlined
def bound_slopes(space, at, width, left, begin, end):
    """Clear the derivatives of a row outside of `begin` to `end`, and of windows beyond the image."""
    for part in range(3):
        line = at + part * WINDOWS
        clear(space, line, line + min(begin, end))
        clear(space, line + end, line + WINDOWS)
        if left == 0 and begin == 0:
            store_first(space, line, RADIUS, zeros())
        for t in range(width - left + RADIUS, end, LANES):
            store_first(space, line + t, end - t, zeros())


@inlined
def blur_slopes(space, group, begin, end):
    """Blur the derivatives of fourteen rows across into four, from `begin` to `end`."""
    rows = around_group(AT_SLOPES, group, SLOPE_RING, SLOPES)
    for t in range(begin, end, LANES):
        for part in range(3):
            row0, row1, row2, row3 = blur_across(space, rows, part * WINDOWS + t, SLOPES)
            at = AT_BLURRED + part * WINDOWS + t
            store(space, at, row0)
            store(space, at + SLOPES, row1)
            store(space, at + 2 * SLOPES, row2)
            store(space, at + 3 * SLOPES, row3)


@inlined
def gradient_row(
    image, image_at, target, target_at, unit, width, left, right, begin, end, slopes, space, ssim_weight, l1_weight, gradient
):  # fmt: skip
    """Write one row of the gradient, zero but from `begin` to `end`, where the derivatives were blurred across; give the row's L1."""
    nothing = zeros()
    l1 = nothing
    for x in range(left, left + begin, LANES):
        write(gradient, image_at + x, right - x, nothing)
    for t in range(begin, end, LANES):
        x = left + t
        a, b = pixels(image, image_at + x, target, target_at + x, unit, width - x)
        difference = a - b
        at = slopes + t + RADIUS
        slope = fma(a + b, blur_along(space, at + WINDOWS), blur_along(space, at))
        slope = fma(difference, blur_along(space, at + 2 * WINDOWS), slope)
        sign = select(difference > F(0), splat(l1_weight), select(difference < F(0), splat(-l1_weight), nothing))
        write(gradient, image_at + x, right - x, fma(slope, splat(F(4) * ssim_weight), sign))
        l1 = l1 + absolute(difference)
    for x in range(left + (end + LANES - 1) // LANES * LANES, right, LANES):
        write(gradient, image_at + x, right - x, nothing)
    return l1


@kernel
def compare_strip(
    image, image_at, target, target_at, pitch, unit, height, width, left, right, ssim_weight, l1_weight, gradient, space, spans, lost, l1
):  # fmt: skip
    """Compare a strip of columns, and write the gradient of `l1_weight sum|x - y| + ssim_weight sum SSIM`.

    Args:
        image: flat float32.
        image_at: where the channel begins; its rows lie `width` apart.
        target: flat float32 or uint8.
        target_at: where the channel begins.
        pitch: from row to row of `target`.
        unit: float32 that turns a value of `target` into [0, 1].
        height: of the image.
        width: of the image.
        left: first column of the strip, a multiple of 16.
        right: one past its last column; at most STRIP columns.
        ssim_weight: float32.
        l1_weight: float32.
        gradient: flat, laid out as `image`; out.
        space: (STRIP_SPACE,) float32 to work in.
        spans: (4, strip_spans(height)) int64 to work in.
        lost: (h,) float32 out, half of 1 - SSIM summed over each row.
        l1: (h,) float32 out, |x - y| summed over each row.
    """
    groups = (height + GROUP - 1) // GROUP
    mark(image, image_at, target, target_at, pitch, unit, height, width, left, right, spans)
    low, high = spans[2], spans[3]
    clear(space, 0, AT_RING)
    clear(space, AT_SLOPES, STRIP_SPACE)
    y = -RADIUS
    for batch in range(0, groups + REACH, BATCH):
        for group in range(batch, batch + BATCH):
            if group >= groups:
                for row in range(GROUP * group, GROUP * (group + 1)):
                    at = in_ring(AT_SLOPES, row, SLOPE_RING, SLOPES)
                    clear(space, at, at + SLOPES)
                continue
            while y < GROUP * (group + 1) + RADIUS:
                begin, end = around(low, high, min(max(y // GROUP, 0), groups - 1) + 2 * REACH)
                slot = in_ring(AT_RING, y, RING, MOMENTS)
                if 0 <= y < height:
                    a, b = image_at + y * width, target_at + y * pitch
                    blur_row(image, a, target, b, unit, width, left, begin, end, space, slot)
                else:
                    clear_row(space, slot, begin, end)
                y += 1
            begin = min(low[group + 2 * REACH], WINDOWS)
            end = max(high[group + 2 * REACH], begin)
            compare_rows(space, group, height, width, left, right, begin, end, lost)
        for group in range(max(batch - REACH, 0), min(batch + BATCH - REACH, groups)):
            begin, end = around(low, high, group + 2 * REACH)
            begin, end = max(begin - LANES, 0), min(end, right - left)
            if begin < end:
                blur_slopes(space, group, begin, min(end + LANES, WINDOWS))
            else:
                begin, end = 0, 0
            for row in range(min(height - GROUP * group, GROUP)):
                at = GROUP * group + row
                a, b, blur = image_at + at * width, target_at + at * pitch, AT_BLURRED + row * SLOPES
                total = gradient_row(
                    image, a, target, b, unit, width, left, right, begin, end, blur, space, ssim_weight, l1_weight, gradient
                )  # fmt: skip
                l1[at] = number(sums((total,)), 0)
