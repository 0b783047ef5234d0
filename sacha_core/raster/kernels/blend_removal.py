r"""What the picture changes by when one Gaussian is removed: the blending repeated, and for each entry the change it stands for.

Without Gaussian i, light that it held back reaches what lies behind. With w its weight, T' the transmittance behind it and `rest` what
lies behind as it is drawn now, background included, the pixel's colour changes by
    d = w (rest / T' - c).

Exact but for pixels that closed. There the Gaussian that closed the pixel was not drawn, and light of up to 1 % of the pixel's went to the
background in its stead; a removal lets up to 100 times as much through, and then draws it. A first pass over the entries therefore finds
who closed each pixel, so that only what lies behind that one is left out: at most 1e-4 / (1 - alpha) of the pixel's light.
Removing the one that closed a pixel counts as no change there, as it is not drawn; it would be at most 1e-2 of the pixel's light.
Source: own.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    absolute,
    fma,
    inlined,
    load,
    load_spread,
    lowest_bit,
    maximum,
    prefetch_to_write,
    select,
    some,
    splat,
    store,
    sums,
    zeros,
)
from sacha_core.raster.kernels.batch import (
    ALPHA,
    BATCH,
    BATCH_SCRATCH,
    COPY,
    FADED,
    RUN,
    let_through,
    open_tile,
    prepare,
    touching,
    write_alphas,
)
from sacha_core.raster.kernels.blend_backward import load_tile
from sacha_core.raster.kernels.blend_weights import load_weights
from sacha_core.raster.kernels.layout import (
    ALPHA_MAX,
    R_COLOUR,
    RECORD,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)

F = np.float32
IMAGES = 2  # of pixel weights
KINDS = 2  # of change: squared and absolute
PARTS = KINDS * IMAGES  # sums of an entry: each kind with either image of weights
CLOSING = F(1.01) * TRANSMITTANCE_MIN / (F(1) - ALPHA_MAX)  # a pixel that shows more of the background has not closed
# planes of the scratch: what lies behind and what the closing Gaussian would add, each of up to four channels; the transmittance that
# closed the pixel, 0 where it is open; pixel weights; then the sums of each entry, lane by lane
REST = BATCH_SCRATCH
HELD = REST + 4 * TILE_PIXELS
CLOSED = HELD + 4 * TILE_PIXELS
WEIGHTS = CLOSED + TILE_PIXELS
SUMS = WEIGHTS + IMAGES * TILE_PIXELS
SUM = PARTS * LANES
REMOVAL_SCRATCH = SUMS + BATCH * SUM


@inlined
def close_vector(word, vector, y, background, scratch):
    """Note, for the pixels of one vector that the entries in `word` close, the transmittance after and the light the closing one held."""
    write_alphas(word, y, scratch)
    pixel = vector * LANES
    run, closed = load(scratch, RUN + pixel), load(scratch, CLOSED + pixel)
    alpha_at = ALPHA
    while word != 0:
        colour = COPY + lowest_bit(word) * RECORD + R_COLOUR
        word &= word - 1
        before = run
        _, run, _ = let_through(load(scratch, alpha_at), run)
        alpha_at += LANES
        closes = (before > splat(TRANSMITTANCE_MIN)) & (run <= splat(TRANSMITTANCE_MIN))
        if some(closes):
            closed = select(closes, run, closed)
            for k in range(len(background)):
                held = (before - run) * (load_spread(scratch, colour + k) - splat(background[k]))
                at = HELD + k * TILE_PIXELS + pixel
                store(scratch, at, select(closes, held, load(scratch, at)))
    store(scratch, RUN + pixel, maximum(run, splat(FADED)))
    store(scratch, CLOSED + pixel, closed)


@inlined
def find_closings(entry, end, entries, records, x_tile, y_lanes, y_tile, background, scratch):
    """Fill the planes `CLOSED` and `HELD` of a tile; the transmittances stay as after the last entry."""
    for at in range(0, TILE_PIXELS, LANES):
        store(scratch, CLOSED + at, zeros())
    for at in range(0, len(background) * TILE_PIXELS, LANES):
        store(scratch, HELD + at, zeros())
    while entry < end:
        count = min(BATCH, end - entry)
        all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
        for vector in range(TILE_VECTORS):
            if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                word = touching(vector, scratch) & all_of_them
                if word != 0:
                    close_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), background, scratch)
        entry += count


@inlined
def removal(k, weight, share, opened, pixel, colour, scratch):
    """Take one Gaussian's part from what lies behind, in one channel, and give how the colour would change without it."""
    at = REST + k * TILE_PIXELS + pixel
    lit = weight * load_spread(scratch, colour + k)
    rest = load(scratch, at) - lit
    store(scratch, at, rest)
    return fma(opened, load(scratch, HELD + k * TILE_PIXELS + pixel), share * rest - lit)


@inlined
def remove_vector(word, vector, y, channels, scratch):
    """Add what one vector of the tile would change by to the sums of the entries that `word` names."""
    write_alphas(word, y, scratch)
    pixel = vector * LANES
    run, closed = load(scratch, RUN + pixel), load(scratch, CLOSED + pixel)
    plain, second = load(scratch, WEIGHTS + pixel), load(scratch, WEIGHTS + TILE_PIXELS + pixel)
    alpha_at = ALPHA
    while word != 0:
        k = lowest_bit(word)
        word &= word - 1
        colour, at = COPY + k * RECORD + R_COLOUR, SUMS + k * SUM
        weight, run, open_ = let_through(load(scratch, alpha_at), run)
        alpha_at += LANES
        share = select(open_, weight / run, zeros())  # alpha / (1 - alpha)
        more = splat(F(1)) + share
        opened = select(more * closed > splat(TRANSMITTANCE_MIN), more, zeros())
        squared, straight = zeros(), zeros()
        for channel in range(channels):
            change = removal(channel, weight, share, opened, pixel, colour, scratch)
            squared = fma(change, change, squared)
            straight = straight + absolute(change)
        add(scratch, at, squared, plain, second)
        add(scratch, at + IMAGES * LANES, straight, plain, second)
    store(scratch, RUN + pixel, maximum(run, splat(FADED)))


@inlined
def add(scratch, at, value, plain, second):
    """Add a vector of pixels to an entry's two sums, by either pixel weight."""
    store(scratch, at, fma(value, plain, load(scratch, at)))
    store(scratch, at + LANES, fma(value, second, load(scratch, at + LANES)))


@inlined
def remove_each(entry, end, entries, records, x_tile, y_lanes, y_tile, channels, entry_sums, scratch):
    """Sum the changes of a tile's entries, and write them to their places."""
    while entry < end:
        count = min(BATCH, end - entry)
        all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
        for k in range(count):
            prefetch_to_write(entry_sums, (entries[entry + k] >> TOP_SHIFT) * RECORD)
        for at in range(0, count * SUM, LANES):
            store(scratch, SUMS + at, zeros())
        for vector in range(TILE_VECTORS):
            if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                word = touching(vector, scratch) & all_of_them
                if word != 0:
                    remove_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), channels, scratch)
        for k in range(count):
            at = SUMS + k * SUM
            parts = (
                load(scratch, at),
                load(scratch, at + LANES),
                load(scratch, at + 2 * LANES),
                load(scratch, at + 3 * LANES),
            )
            store(entry_sums, (entries[entry + k] >> TOP_SHIFT) * RECORD, sums(parts))
        entry += count


@inlined
def load_images(channels, image, transmittance, pixel_weights, top, left, width, height, across, rows, scratch):
    """Copy a tile's colours and weights; tell whether a pixel may have closed."""
    for k in range(channels):
        corner = (k * height + top) * width + left
        load_tile(image, corner, width, across, rows, scratch, REST + k * TILE_PIXELS)
    load_weights(pixel_weights, IMAGES, top, left, width, height, across, rows, scratch, WEIGHTS)
    load_tile(transmittance, top * width + left, width, across, rows, scratch, CLOSED)
    closed = False
    for at in range(0, TILE_PIXELS, LANES):
        closed = closed or some(load(scratch, CLOSED + at) <= splat(CLOSING))
    return closed


@kernel
def blend_removal(
    first_tile, last_tile, start, done, entries, records, x_lanes, y_lanes, background, image, transmittance, width, height,
    pixel_weights, entry_sums, scratch,
):  # fmt: skip
    """Sum, for every entry of the tiles `first_tile` up to `last_tile`, how the picture would change without it.

    Arguments as of `blend_backward`; further
        background: tuple of as many channels as count, the first ones of the image.
        pixel_weights: up to two images of (h, w), flat.
        entry_sums: (keys, 16) result, flat: the squared and the absolute change, by either weight.
        scratch: (REMOVAL_SCRATCH,) aligned space.
    """
    channels, columns = len(background), len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        for e in range(done[tile], start[tile + 1]):
            store(entry_sums, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
        entry, end = start[tile], done[tile]
        if entry == end:
            continue
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        may_close = load_images(
            channels, image, transmittance, pixel_weights, top, left, width, height, across, rows, scratch
        )
        open_tile(scratch, across, rows)
        last = end if may_close else entry
        find_closings(entry, last, entries, records, x_tile, y_lanes, y_tile, background, scratch)
        open_tile(scratch, across, rows)
        remove_each(entry, end, entries, records, x_tile, y_lanes, y_tile, channels, entry_sums, scratch)
