"""Fourth stage: repeat the blending front to back and sum the gradients of each entry.

Going front to back needs no record of where each pixel stopped: with `rest` the part of the gradient's image that lies behind,
    dL/dalpha = T q - rest / (1 - alpha),   q = sum_k c_k dL/dC_k,
and `rest` starts at sum_k dL/dC_k C_k, background included, and loses w q at each Gaussian.
Alpha times that, with w = alpha T and T' = T (1 - alpha), is w (q - rest / T').
Each entry has a place of its own to write to, so no order of threads can change a bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sacha_core.raster.kernels.blend import AHEAD, alpha_power, open_tile
from sacha_core.raster.kernels.lanes import (
    LANES,
    absolute,
    fma,
    load,
    load_halves,
    load_spread,
    minimum,
    prefetch,
    select,
    splat,
    store,
    sums,
    within,
    zeros,
)
from sacha_core.raster.kernels.layout import (
    ALPHA_MAX,
    GAUSSIAN_MASK,
    GAUSSIAN_SHIFT,
    POWER_MIN,
    R_A,
    R_B,
    R_C,
    R_COLOUR,
    R_OPACITY,
    R_X,
    R_Y,
    RECORD,
    ROW_BITS,
    ROW_MASK,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)

F = np.float32
REST = TILE_PIXELS  # plane of the scratch; the gradients of up to four channels follow
UPSTREAM = 2 * TILE_PIXELS
SPARE = 6 * TILE_PIXELS
BACKWARD_SCRATCH = 7 * TILE_PIXELS


@within
def load_tile(image, corner, width, across, rows, scratch, plane):
    """Copy a tile's part of a flat image, whose first pixel is at `corner`, into a plane of the scratch; zero outside."""
    if across == TILE_WIDTH and rows == TILE_HEIGHT:
        for vector in range(TILE_VECTORS):
            at = corner + 2 * vector * width
            store(scratch, plane + vector * LANES, load_halves(image, at, at + width))
    else:
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                scratch[plane + y * TILE_WIDTH + x] = image[corner + y * width + x] if y < rows and x < across else F(0)


@within
def add_product(scratch, a, b):
    """Add the product of two planes of the scratch to the rest."""
    for at in range(0, TILE_PIXELS, LANES):
        store(scratch, REST + at, fma(load(scratch, a + at), load(scratch, b + at), load(scratch, REST + at)))


@within
def load_gradients(
    channels, image, transmittance, image_gradient, transmittance_gradient, corner, width, height, across, rows, scratch
):
    """Copy the tile's gradients, and start the rest: gradient times image, and the transmittance's share where it has a gradient."""
    for at in range(0, TILE_PIXELS, LANES):
        store(scratch, REST + at, zeros())
    for k in range(channels):
        plane = UPSTREAM + k * TILE_PIXELS
        load_tile(image_gradient, corner + k * width * height, width, across, rows, scratch, plane)
        load_tile(image, corner + k * width * height, width, across, rows, scratch, SPARE)
        add_product(scratch, plane, SPARE)
    if len(transmittance_gradient) > 0:
        load_tile(transmittance, corner, width, across, rows, scratch, 0)
        load_tile(transmittance_gradient, corner, width, across, rows, scratch, SPARE)
        add_product(scratch, 0, SPARE)


@njit(cache=True, nogil=True)
def blend_backward(  # noqa: PLR0915 - one loop, whose sums live in registers
    first_tile, last_tile, start, done, entries, records, x_lanes, y_lanes, background, image, transmittance, width, height,
    image_gradient, transmittance_gradient, entry_gradients, scratch,
):  # fmt: skip
    """Sum the gradients of every entry of the tiles `first_tile` up to `last_tile`.

    Arguments as of `blend`; further
        image_gradient: (c, h, w) gradient of the loss by the image, flat.
        transmittance_gradient: (h, w), flat; empty for none.
        entry_gradients: (keys, 16) result, flat: the row of an entry is the position of its key.
    """
    channels = len(background)
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        for e in range(done[tile], start[tile + 1]):
            store(entry_gradients, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
        end = done[tile]
        if start[tile] == end:
            continue
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        load_gradients(
            channels, image, transmittance, image_gradient, transmittance_gradient, top * width + left, width, height, across, rows, scratch
        )  # fmt: skip
        open_tile(scratch, across, rows)
        x_tile = load(x_lanes, tile % columns * LANES)
        y_tile = tile // columns * TILE_VECTORS
        for e in range(start[tile], end):
            prefetch(records, ((entries[e + AHEAD] >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD)
            entry = entries[e]
            at = ((entry >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD
            dx = x_tile - load_spread(records, at + R_X)
            mean_y = load_spread(records, at + R_Y)
            across_power = fma(load_spread(records, at + R_A) * dx, dx, load_spread(records, at + R_OPACITY))
            slope = load_spread(records, at + R_B) * dx
            curve = load_spread(records, at + R_C)
            shade0, shade1 = load_spread(records, at + R_COLOUR), load_spread(records, at + R_COLOUR + 1)
            shade2, shade3 = load_spread(records, at + R_COLOUR + 2), load_spread(records, at + R_COLOUR + 3)
            sum_s, sum_y, sum_yy = zeros(), zeros(), zeros()
            colour0, colour1, colour2, colour3 = zeros(), zeros(), zeros(), zeros()
            for vector in range((entry >> ROW_BITS & ROW_MASK) >> 1, ((entry & ROW_MASK) >> 1) + 1):
                dy = load(y_lanes, (y_tile + vector) * LANES) - mean_y
                power = fma(fma(curve, dy, slope), dy, across_power)
                unclamped = alpha_power(power)
                alpha = minimum(unclamped, splat(ALPHA_MAX))
                alpha = select(power >= splat(POWER_MIN), alpha, zeros())
                pixel = vector * LANES
                t = load(scratch, pixel)
                weight = alpha * t
                after = t - weight
                open_ = after > splat(TRANSMITTANCE_MIN)
                store(scratch, pixel, select(open_, after, -absolute(t)))
                weight = select(open_, weight, zeros())
                upstream = load(scratch, UPSTREAM + pixel)
                q = shade0 * upstream
                colour0 = fma(weight, upstream, colour0)
                if channels > 1:
                    upstream = load(scratch, UPSTREAM + TILE_PIXELS + pixel)
                    q = fma(shade1, upstream, q)
                    colour1 = fma(weight, upstream, colour1)
                if channels > 2:
                    upstream = load(scratch, UPSTREAM + 2 * TILE_PIXELS + pixel)
                    q = fma(shade2, upstream, q)
                    colour2 = fma(weight, upstream, colour2)
                if channels > 3:
                    upstream = load(scratch, UPSTREAM + 3 * TILE_PIXELS + pixel)
                    q = fma(shade3, upstream, q)
                    colour3 = fma(weight, upstream, colour3)
                rest = load(scratch, REST + pixel) - weight * q
                store(scratch, REST + pixel, rest)
                s = select(open_ & (unclamped < splat(ALPHA_MAX)), weight * (q - rest / after), zeros())
                s_dy = s * dy
                sum_s = sum_s + s
                sum_y = sum_y + s_dy
                sum_yy = fma(s_dy, dy, sum_yy)
            sum_x = sum_s * dx
            gathered = sums((
                sum_s, sum_x, sum_y, sum_x * dx, sum_y * dx, sum_yy, colour0, colour1, colour2, colour3,
            ))  # fmt: skip
            store(entry_gradients, (entries[e] >> TOP_SHIFT) * RECORD, gathered)


@njit(cache=True, nogil=True)
def blend_weights(
    first_tile, last_tile, start, done, entries, records, x_lanes, y_lanes, pixel_weights, width, height, entry_sums, scratch
):  # fmt: skip
    """Sum, for every entry, the blending weight times four images of pixel weights (4, h, w), flat; arguments as of `blend_backward`."""
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        for e in range(done[tile], start[tile + 1]):
            store(entry_sums, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        open_tile(scratch, across, rows)
        for k in range(4):
            corner = (k * height + top) * width + left
            load_tile(pixel_weights, corner, width, across, rows, scratch, UPSTREAM + k * TILE_PIXELS)
        x_tile = load(x_lanes, tile % columns * LANES)
        y_tile = tile // columns * TILE_VECTORS
        for e in range(start[tile], done[tile]):
            entry = entries[e]
            at = ((entry >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD
            dx = x_tile - load_spread(records, at + R_X)
            mean_y = load_spread(records, at + R_Y)
            across_power = fma(load_spread(records, at + R_A) * dx, dx, load_spread(records, at + R_OPACITY))
            slope = load_spread(records, at + R_B) * dx
            curve = load_spread(records, at + R_C)
            sum0, sum1, sum2, sum3 = zeros(), zeros(), zeros(), zeros()
            for vector in range((entry >> ROW_BITS & ROW_MASK) >> 1, ((entry & ROW_MASK) >> 1) + 1):
                dy = load(y_lanes, (y_tile + vector) * LANES) - mean_y
                power = fma(fma(curve, dy, slope), dy, across_power)
                alpha = minimum(alpha_power(power), splat(ALPHA_MAX))
                alpha = select(power >= splat(POWER_MIN), alpha, zeros())
                pixel = vector * LANES
                t = load(scratch, pixel)
                weight = alpha * t
                after = t - weight
                open_ = after > splat(TRANSMITTANCE_MIN)
                store(scratch, pixel, select(open_, after, -absolute(t)))
                weight = select(open_, weight, zeros())
                sum0 = fma(weight, load(scratch, UPSTREAM + pixel), sum0)
                sum1 = fma(weight, load(scratch, UPSTREAM + TILE_PIXELS + pixel), sum1)
                sum2 = fma(weight, load(scratch, UPSTREAM + 2 * TILE_PIXELS + pixel), sum2)
                sum3 = fma(weight, load(scratch, UPSTREAM + 3 * TILE_PIXELS + pixel), sum3)
            store(entry_sums, (entries[e] >> TOP_SHIFT) * RECORD, sums((sum0, sum1, sum2, sum3)))
