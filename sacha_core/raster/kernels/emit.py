"""First stage, second part: emit one key for every tile that a Gaussian touches."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.lanes import (
    LANES,
    bits,
    ceiling,
    floor,
    inlined,
    lowest_bit,
    maximum,
    minimum,
    moved_up,
    select,
    some,
    splat,
    square_root,
    store_key,
    store_whole,
    zeros,
)
from sacha_core.raster.kernels.layout import BOX_MARGIN, KEY_BITS, TILE_HEIGHT, TILE_WIDTH

F = np.float32
BEGIN, UNTIL, PLACE, KEY = 0, LANES, 2 * LANES, 3 * LANES  # parts of the scratch, which holds integers
EMIT_SCRATCH = 4 * LANES


@inlined
def rows_of_column(left, box, outline):
    """Give the first and last row of pixels that splats reach in a column of tiles; `left`: x of its first pixel, from each mean.

    At dx from the mean the ellipse of alpha = 1/255 reaches shear dx +- sqrt(spread (limit - dx^2 / xx)), where shear = xy / xx and
    spread = det / xx. It is lowest in the image at dx = apex and highest at -apex, or where a column comes nearest to that.
    """
    _, middle, limit, shear, spread, inverse_xx, apex = outline
    right = left + F(TILE_WIDTH - 1)
    down, up = minimum(maximum(apex, left), right), minimum(maximum(-apex, left), right)
    fall = shear * down + square_root(maximum((limit - down * down * inverse_xx) * spread, zeros()))
    rise = shear * up - square_root(maximum((limit - up * up * inverse_xx) * spread, zeros()))
    first, last = ceiling(middle + rise - BOX_MARGIN), floor(middle + fall + BOX_MARGIN)
    return maximum(first, box[2]), minimum(last, box[3])


@inlined
def emit_block(keep, box, outline, columns, at, base, used, keys, span, histogram, scratch):
    """Emit the keys of sixteen Gaussians, all at a time: column after column of their boxes, and row after row of tiles.

    Args:
        keep: which of them are seen.
        box: first and last column and row of pixels of each.
        outline: see `rows_of_column`; first the mean's place in the image.
        columns: of tiles.
        at: first of the Gaussians.
        base: position of keys[0] among all keys.
        used: how many of `keys` are used already.
        keys: result; the keys of a Gaussian lie together, with room after them for as many tiles as its box touches.
        span: result, see `project`.
        histogram: number of keys of each tile, counted up.
        scratch: space.

    Returns:
        How many of `keys` are used now, or -1 where there is no room.
    """
    column, column_end = floor(box[0] * F(1 / TILE_WIDTH)), floor(box[1] * F(1 / TILE_WIDTH))
    tall = floor(box[3] * F(1 / TILE_HEIGHT)) - floor(box[2] * F(1 / TILE_HEIGHT)) + F(1)
    room = select(keep, (column_end - column + F(1)) * tall, zeros())
    until = room + moved_up(room, 1)  # sums up to each lane
    until = until + moved_up(until, 2)
    until = until + moved_up(until, 4)
    until = until + moved_up(until, 8)
    place = until - room
    store_whole(scratch, BEGIN, place)
    store_whole(scratch, UNTIL, until)
    total = np.int64(scratch[UNTIL + LANES - 1])
    if used + total > len(keys):
        return np.int64(-1)
    going = keep
    while some(going):
        first, last = rows_of_column(column * F(TILE_WIDTH) + (F(0.5) - outline[0]), box, outline)
        line, line_end = floor(first * F(1 / TILE_HEIGHT)), floor(last * F(1 / TILE_HEIGHT))
        writing = going & (first <= last)
        while some(writing):
            top = line * F(TILE_HEIGHT)
            begin, end = maximum(first - top, zeros()), minimum(last - top, splat(F(TILE_HEIGHT - 1)))
            store_key(scratch, KEY, line * F(columns) + column, begin, end)
            store_whole(scratch, PLACE, place)
            word = bits(writing)
            while word != 0:
                lane = lowest_bit(word)
                word &= word - 1
                key = scratch[
                    np.uint64(KEY + lane)
                ]  # indices without a sign need no look at whether they count from the end
                keys[np.uint64(used + scratch[np.uint64(PLACE + lane)])] = key
                histogram[np.uint64(key >> KEY_BITS)] += 1
            place = select(writing, place + F(1), place)
            line = line + F(1)
            writing = writing & (line <= line_end)
        column = column + F(1)
        going = going & (column <= column_end)
    store_whole(scratch, PLACE, place)
    for lane in range(LANES):
        span[2 * (at + lane)] = base + used + scratch[BEGIN + lane]
        span[2 * (at + lane) + 1] = scratch[PLACE + lane] - scratch[BEGIN + lane]
    return used + total
