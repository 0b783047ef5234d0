"""Third stage: emit one key for every tile that a Gaussian touches, front to back, and deal the keys out to the tiles."""

from __future__ import annotations

import numpy as np
from numba import njit

from sacha_core.raster.kernels.lanes import (
    LANES,
    ceiling,
    floor,
    load_spread,
    maximum,
    minimum,
    prefetch,
    ramp,
    splat,
    square_root,
    store,
    within,
    zeros,
)
from sacha_core.raster.kernels.layout import (
    GAUSSIAN_SHIFT,
    LOW_MASK,
    POWER_SCALE,
    R_APEX,
    R_COLUMNS,
    R_INVERSE,
    R_OPACITY,
    R_ROWS,
    R_SHEAR,
    R_SPREAD,
    R_X,
    R_Y,
    RECORD,
    ROW_BITS,
    TILE_HEIGHT,
    TILE_WIDTH,
    TOP_SHIFT,
    V_CX,
    V_CY,
)
from sacha_core.raster.kernels.project import BOX_MARGIN, LOG2_255, TWICE_LN2

F = np.float32
AHEAD = 8  # Gaussians that a record is asked for in advance
EMIT_SCRATCH = 2 * LANES


@within
def outline(column, records, at, view, scratch):
    """Write how far up and down a splat reaches in each of sixteen columns of tiles: first and last row of pixels, real numbers.

    At dx from the mean the ellipse of alpha = 1/255 reaches shear dx +- sqrt(spread (limit - dx^2 / xx)), where shear = xy / xx and
    spread = det / xx. It is lowest in the image at dx = apex and highest at -apex, or where a column comes nearest to that.
    """
    limit = (load_spread(records, at + R_OPACITY) * F(POWER_SCALE) + LOG2_255) * TWICE_LN2
    shear, spread = load_spread(records, at + R_SHEAR), load_spread(records, at + R_SPREAD)
    inverse, apex = load_spread(records, at + R_INVERSE), load_spread(records, at + R_APEX)
    left = ramp() * F(TILE_WIDTH) + (F(column * TILE_WIDTH) + F(0.5) - (records[at + R_X] + view[V_CX]))
    right = left + F(TILE_WIDTH - 1)
    down, up = minimum(maximum(apex, left), right), minimum(maximum(-apex, left), right)
    fall = shear * down + square_root(maximum((limit - down * down * inverse) * spread, zeros()))
    rise = shear * up - square_root(maximum((limit - up * up * inverse) * spread, zeros()))
    middle = splat(records[at + R_Y] + view[V_CY] - F(0.5))
    store(scratch, 0, ceiling(middle + rise - BOX_MARGIN))
    store(scratch, LANES, floor(middle + fall + BOX_MARGIN))


@within
def emit_column(g, column, columns, top, bottom, keys, position, histogram):
    """Write the keys of one column of tiles for the rows `top` to `bottom` of pixels; give the next free position."""
    first, last = top // TILE_HEIGHT, bottom // TILE_HEIGHT
    for row in range(first, last + 1):
        begin = top - row * TILE_HEIGHT if row == first else 0
        end = bottom - row * TILE_HEIGHT if row == last else TILE_HEIGHT - 1
        tile = row * columns + column
        keys[position] = tile << TOP_SHIFT | g << GAUSSIAN_SHIFT | begin << ROW_BITS | end
        histogram[tile] += 1
        position += 1
    return position


@njit(cache=True, nogil=True)
def emit(order, start, stop, records, words, view, columns, base, keys, histogram, span, scratch):
    """Emit the keys of the Gaussians order[start:stop] into a slice of keys that begins at `base`.

    Args:
        order: Gaussians by depth.
        start: range of them.
        stop: its end.
        records: (n, 16), flat.
        words: the same memory as integers.
        view: camera parameters.
        columns: of tiles.
        base: position of keys[0] among all keys.
        keys: result.
        histogram: (tiles,) result: number of keys of each tile in this slice.
        span: (n, 2) result, flat: position of the first key and number of keys.
        scratch: (EMIT_SCRATCH,) space.

    Returns:
        The number of keys, or -1 where there is no room.
    """
    for tile in range(len(histogram)):
        histogram[tile] = 0
    position = 0
    for k in range(start, stop):
        if k + AHEAD < stop:
            prefetch(records, order[k + AHEAD] * RECORD)
        g = np.int64(order[k])
        at = g * RECORD
        left, right = (words[at + R_COLUMNS] & 0xFFFF) // TILE_WIDTH, (words[at + R_COLUMNS] >> 16) // TILE_WIDTH
        top, bottom = words[at + R_ROWS] & 0xFFFF, words[at + R_ROWS] >> 16
        if position + (right - left + 1) * (bottom // TILE_HEIGHT - top // TILE_HEIGHT + 1) > len(keys):
            return -1
        before = position
        if left == right:
            position = emit_column(g, left, columns, top, bottom, keys, position, histogram)
        else:
            for column in range(left, right + 1):
                lane = (column - left) % LANES
                if lane == 0:
                    outline(column, records, at, view, scratch)
                first, last = max(int(scratch[lane]), top), min(int(scratch[LANES + lane]), bottom)
                if first <= last:
                    position = emit_column(g, column, columns, first, last, keys, position, histogram)
        span[2 * g] = base + before
        span[2 * g + 1] = position - before
    return position


@njit(cache=True, nogil=True)
def count_up(histograms, start):
    """Turn the jobs' histograms (jobs, tiles) into where each job's first entry of a tile goes; `start` gets each tile's first."""
    total = 0
    jobs, tiles = histograms.shape
    for tile in range(tiles):
        start[tile] = total
        for job in range(jobs):
            here = histograms[job, tile]
            histograms[job, tile] = total
            total += here
    start[tiles] = total


@njit(cache=True, nogil=True)
def deal(keys, used, base, cursor, entries):
    """Deal the first `used` keys of a slice that begins at `base` out to their tiles."""
    for i in range(used):
        key = keys[i]
        tile = key >> TOP_SHIFT
        entries[cursor[tile]] = np.int64(base + i) << TOP_SHIFT | (key & LOW_MASK)
        cursor[tile] += 1
