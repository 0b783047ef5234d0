"""Third stage: blend the entries of each tile front to back."""

from __future__ import annotations

import numpy as np
from numba import njit

from sacha_core.raster.kernels.lanes import (
    LANES,
    absolute,
    fma,
    load,
    load_spread,
    maximum,
    minimum,
    prefetch,
    select,
    some,
    splat,
    store,
    store_halves,
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
    TRANSMITTANCE_MIN,
)

F = np.float32
LIVE_CHECK = 16  # entries between two looks at whether any pixel is still open
AHEAD = 6  # entries that a record is asked for in advance
BLEND_SCRATCH = 6 * TILE_PIXELS  # planes: transmittance, up to four channels, one for writing out

# 2^x on [-1, 0] by Chebyshev interpolation of degree 5; relative error 8e-8
E0, E1, E2, E3, E4, E5 = (
    F(c)
    for c in np.polynomial.chebyshev.Chebyshev.interpolate(np.exp2, 5, domain=[-1, 0])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)


@within
def alpha_power(power):
    """Give 2^(8 power) for power in [-1, 0], growing on beyond; relative error below 1e-6."""
    x = maximum(power, splat(F(-1)))
    y = fma(fma(fma(fma(fma(splat(E5), x, splat(E4)), x, splat(E3)), x, splat(E2)), x, splat(E1)), x, splat(E0))
    y = y * y
    y = y * y
    return y * y


@within
def open_tile(scratch, across, rows):
    """Set a tile's transmittance: 1 in the image, -1 (closed) outside."""
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            scratch[y * TILE_WIDTH + x] = F(1) if x < across and y < rows else F(-1)


@within
def any_open(scratch):
    """Is any pixel of the tile still open?"""
    highest = load(scratch, 0)
    for vector in range(1, TILE_VECTORS):
        highest = maximum(highest, load(scratch, vector * LANES))
    return some(highest > zeros())


@within
def blend_entry(entry, records, x_tile, y_lanes, y_tile, channels, scratch):
    """Blend one Gaussian into the rows of a tile that its entry names."""
    at = ((entry >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD
    dx = x_tile - load_spread(records, at + R_X)
    mean_y = load_spread(records, at + R_Y)
    across_power = fma(load_spread(records, at + R_A) * dx, dx, load_spread(records, at + R_OPACITY))
    slope = load_spread(records, at + R_B) * dx
    curve = load_spread(records, at + R_C)
    colour0, colour1 = load_spread(records, at + R_COLOUR), load_spread(records, at + R_COLOUR + 1)
    colour2, colour3 = load_spread(records, at + R_COLOUR + 2), load_spread(records, at + R_COLOUR + 3)
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
        accumulate(scratch, TILE_PIXELS + pixel, weight, colour0)
        if channels > 1:
            accumulate(scratch, 2 * TILE_PIXELS + pixel, weight, colour1)
        if channels > 2:
            accumulate(scratch, 3 * TILE_PIXELS + pixel, weight, colour2)
        if channels > 3:
            accumulate(scratch, 4 * TILE_PIXELS + pixel, weight, colour3)


@within
def accumulate(scratch, at, weight, colour):
    """Add weight times colour to sixteen pixels of a plane."""
    store(scratch, at, fma(weight, colour, load(scratch, at)))


@within
def write_tile(scratch, background, image, transmittance, left, top, across, rows, width, height):
    """Copy a blended tile to the images, with the background behind it."""
    for vector in range(TILE_VECTORS):
        store(scratch, vector * LANES, absolute(load(scratch, vector * LANES)))
    for k in range(len(background)):
        behind = splat(background[k])
        for vector in range(TILE_VECTORS):
            at = (k + 1) * TILE_PIXELS + vector * LANES
            store(scratch, at, fma(behind, load(scratch, vector * LANES), load(scratch, at)))
    for k in range(-1, len(background)):
        plane = (k + 1) * TILE_PIXELS
        target = transmittance if k < 0 else image
        corner = max(k, 0) * height * width + top * width + left
        if across == TILE_WIDTH and rows == TILE_HEIGHT:
            for vector in range(TILE_VECTORS):
                at = corner + 2 * vector * width
                store_halves(target, at, at + width, load(scratch, plane + vector * LANES))
        else:
            for y in range(rows):
                for x in range(across):
                    target[corner + y * width + x] = scratch[plane + y * TILE_WIDTH + x]


@njit(cache=True, nogil=True)
def blend(
    first_tile,
    last_tile,
    start,
    entries,
    records,
    x_lanes,
    y_lanes,
    background,
    image,
    transmittance,
    width,
    height,
    done,
    scratch,
):
    """Blend the tiles `first_tile` up to `last_tile`.

    Args:
        first_tile: first of a range of tiles, row by row.
        last_tile: end of the range.
        start: (tiles + 1,) first entry of each tile.
        entries: of all tiles, see `layout`.
        records: (n, 16), flat.
        x_lanes: (tile columns, 16), flat: x of each lane relative to the principal point, pixels.
        y_lanes: (tile rows x 16, 16), flat: y of each lane.
        background: tuple of c float32; its length is the number of channels.
        image: (c, h, w) result, flat.
        transmittance: (h, w) result, flat.
        width: of the image, pixels.
        height: likewise.
        done: (tiles,) result: first entry of each tile that was not blended.
        scratch: (BLEND_SCRATCH,) aligned space.
    """
    channels = len(background)
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        entry, end = start[tile], start[tile + 1]
        open_tile(scratch, across, rows)
        for plane in range(TILE_VECTORS, (channels + 1) * TILE_VECTORS):
            store(scratch, plane * LANES, zeros())
        x_tile = load(x_lanes, tile % columns * LANES)
        y_tile = tile // columns * TILE_VECTORS
        while entry < end:
            pause = min(entry + LIVE_CHECK, end)
            for e in range(entry, pause):
                prefetch(records, ((entries[e + AHEAD] >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD)
                blend_entry(entries[e], records, x_tile, y_lanes, y_tile, channels, scratch)
            entry = pause
            if not any_open(scratch):
                break
        done[tile] = entry
        write_tile(scratch, background, image, transmittance, left, top, across, rows, width, height)
