"""Fourth stage: repeat the blending front to back and sum the gradients of each entry.

Going front to back needs no record of where each pixel stopped: with `rest` the part of the gradient's image that lies behind,
    dL/dalpha = T q - rest / (1 - alpha),   q = sum_k c_k dL/dC_k,
and `rest` starts at sum_k dL/dC_k C_k, background included, and loses w q at each Gaussian.
Alpha times that, with w = alpha T and T' = T (1 - alpha), is w (q - rest / T').
Each entry has a place of its own to write to, so no order of threads can change a bit.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    fma,
    inlined,
    load,
    load_halves,
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
from sacha_core.raster.kernels.layout import (
    ALPHA_MAX,
    R_COLOUR,
    R_X,
    R_Y,
    RECORD,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)

F = np.float32
# planes of the scratch: the rest, the gradients of up to four channels, one to spare; then the sums of each entry, lane by lane
REST = BATCH_SCRATCH
UPSTREAM = REST + TILE_PIXELS
SPARE = UPSTREAM + 4 * TILE_PIXELS
SUMS = SPARE + TILE_PIXELS
S_S, S_Y, S_YY, S_COLOUR = 0, LANES, 2 * LANES, 3 * LANES  # of s, s dy, s dy^2 and w dL/dC
SUM = 7 * LANES  # of one entry
BACKWARD_SCRATCH = SUMS + BATCH * SUM


@inlined
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


@inlined
def add_product(scratch, a, b):
    """Add the product of two planes of the scratch to the rest."""
    for at in range(0, TILE_PIXELS, LANES):
        store(scratch, REST + at, fma(load(scratch, a + at), load(scratch, b + at), load(scratch, REST + at)))


@inlined
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
        load_tile(transmittance, corner, width, across, rows, scratch, RUN)
        load_tile(transmittance_gradient, corner, width, across, rows, scratch, SPARE)
        add_product(scratch, RUN, SPARE)


@inlined
def clear_sums(entry, count, parts, entries, entry_gradients, scratch):
    """Set the sums of a batch's entries to zero, and ask for the memory that they go to."""
    for k in range(count):
        prefetch_to_write(entry_gradients, (entries[entry + k] >> TOP_SHIFT) * RECORD)
        for part in range(parts):
            store(scratch, SUMS + k * SUM + part * LANES, zeros())


@inlined
def add_to(scratch, at, value):
    """Add to sixteen numbers of the scratch."""
    store(scratch, at, load(scratch, at) + value)


@inlined
def add_product_to(scratch, at, a, b):
    """Add a product to sixteen numbers of the scratch."""
    store(scratch, at, fma(a, b, load(scratch, at)))


@inlined
def blend_vector_backward(word, vector, y, channels, scratch):
    """Add what one vector of the tile gives to the sums of the entries that `word` names."""
    write_alphas(word, y, scratch)
    pixel = vector * LANES
    run, rest = load(scratch, RUN + pixel), load(scratch, REST + pixel)
    up0 = load(scratch, UPSTREAM + pixel)
    up1 = load(scratch, UPSTREAM + TILE_PIXELS + pixel)
    up2 = load(scratch, UPSTREAM + 2 * TILE_PIXELS + pixel)
    up3 = load(scratch, UPSTREAM + 3 * TILE_PIXELS + pixel)
    alpha_at = ALPHA
    while word != 0:
        k = lowest_bit(word)
        word &= word - 1
        colour, at = COPY + k * RECORD + R_COLOUR, SUMS + k * SUM
        dy = y - load_spread(scratch, COPY + k * RECORD + R_Y)
        alpha = load(scratch, alpha_at)
        alpha_at += LANES
        weight, run, open_ = let_through(alpha, run)
        q = load_spread(scratch, colour) * up0
        add_product_to(scratch, at + S_COLOUR, weight, up0)
        if channels > 1:
            q = fma(load_spread(scratch, colour + 1), up1, q)
            add_product_to(scratch, at + S_COLOUR + LANES, weight, up1)
        if channels > 2:
            q = fma(load_spread(scratch, colour + 2), up2, q)
            add_product_to(scratch, at + S_COLOUR + 2 * LANES, weight, up2)
        if channels > 3:
            q = fma(load_spread(scratch, colour + 3), up3, q)
            add_product_to(scratch, at + S_COLOUR + 3 * LANES, weight, up3)
        rest = rest - weight * q
        s = select(open_ & (alpha < splat(ALPHA_MAX)), weight * (q - rest / run), zeros())
        s_dy = s * dy
        add_to(scratch, at + S_S, s)
        add_to(scratch, at + S_Y, s_dy)
        add_product_to(scratch, at + S_YY, s_dy, dy)
    store(scratch, RUN + pixel, maximum(run, splat(FADED)))
    store(scratch, REST + pixel, rest)


@inlined
def write_sums(entry, count, x_tile, channels, entries, entry_gradients, scratch):
    """Write the gradient sums of a batch's entries to their places."""
    for k in range(count):
        at = SUMS + k * SUM
        dx = x_tile - load_spread(scratch, COPY + k * RECORD + R_X)
        s, s_dy, s_dyy = load(scratch, at + S_S), load(scratch, at + S_Y), load(scratch, at + S_YY)
        s_dx = s * dx
        gathered = sums((
            s, s_dx, s_dy, s_dx * dx, s_dy * dx, s_dyy,
            load(scratch, at + S_COLOUR),
            load(scratch, at + S_COLOUR + LANES) if channels > 1 else zeros(),
            load(scratch, at + S_COLOUR + 2 * LANES) if channels > 2 else zeros(),
            load(scratch, at + S_COLOUR + 3 * LANES) if channels > 3 else zeros(),
        ))  # fmt: skip
        store(entry_gradients, (entries[entry + k] >> TOP_SHIFT) * RECORD, gathered)


@kernel
def blend_backward(
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
        entry, end = start[tile], done[tile]
        if entry == end:
            continue
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        load_gradients(
            channels, image, transmittance, image_gradient, transmittance_gradient, top * width + left, width, height, across, rows, scratch
        )  # fmt: skip
        open_tile(scratch, across, rows)
        while entry < end:
            count = min(BATCH, end - entry)
            all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
            clear_sums(entry, count, 3 + channels, entries, entry_gradients, scratch)
            for vector in range(TILE_VECTORS):
                if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                    word = touching(vector, scratch) & all_of_them
                    if word != 0:
                        blend_vector_backward(word, vector, load(y_lanes, (y_tile + vector) * LANES), channels, scratch)
            write_sums(entry, count, x_tile, channels, entries, entry_gradients, scratch)
            entry += count
