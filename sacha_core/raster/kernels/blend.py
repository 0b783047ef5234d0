"""Third stage: blend the entries of each tile front to back."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    fma,
    inlined,
    load,
    load_spread,
    lowest_bit,
    maximum,
    select,
    some,
    splat,
    store,
    store_halves,
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
    R_COLOUR,
    RECORD,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_VECTORS,
    TILE_WIDTH,
    TRANSMITTANCE_MIN,
)

F = np.float32
# planes of the scratch: the transmittance where each pixel closed, and up to four channels
FINAL = BATCH_SCRATCH
SHADE = FINAL + TILE_PIXELS
BLEND_SCRATCH = SHADE + 4 * TILE_PIXELS


@inlined
def blend_vector(word, vector, y, channels, scratch):
    """Blend the entries that `word` names into one vector of the tile."""
    write_alphas(word, y, scratch)
    pixel = vector * LANES
    run, final = load(scratch, RUN + pixel), load(scratch, FINAL + pixel)
    colour0 = load(scratch, SHADE + pixel)
    colour1 = load(scratch, SHADE + TILE_PIXELS + pixel) if channels > 1 else zeros()
    colour2 = load(scratch, SHADE + 2 * TILE_PIXELS + pixel) if channels > 2 else zeros()
    colour3 = load(scratch, SHADE + 3 * TILE_PIXELS + pixel) if channels > 3 else zeros()
    at = ALPHA
    while word != 0:
        colour = COPY + lowest_bit(word) * RECORD + R_COLOUR
        word &= word - 1
        weight, run, open_ = let_through(load(scratch, at), run)
        at += LANES
        final = select(open_, run, final)
        colour0 = fma(weight, load_spread(scratch, colour), colour0)
        if channels > 1:
            colour1 = fma(weight, load_spread(scratch, colour + 1), colour1)
        if channels > 2:
            colour2 = fma(weight, load_spread(scratch, colour + 2), colour2)
        if channels > 3:
            colour3 = fma(weight, load_spread(scratch, colour + 3), colour3)
    store(scratch, RUN + pixel, maximum(run, splat(FADED)))
    store(scratch, FINAL + pixel, final)
    store(scratch, SHADE + pixel, colour0)
    if channels > 1:
        store(scratch, SHADE + TILE_PIXELS + pixel, colour1)
    if channels > 2:
        store(scratch, SHADE + 2 * TILE_PIXELS + pixel, colour2)
    if channels > 3:
        store(scratch, SHADE + 3 * TILE_PIXELS + pixel, colour3)


@inlined
def write_tile(scratch, background, image, transmittance, left, top, across, rows, width, height):
    """Copy a blended tile to the images, with the background behind it."""
    for k in range(len(background)):
        behind = splat(background[k])
        for vector in range(TILE_VECTORS):
            at = SHADE + k * TILE_PIXELS + vector * LANES
            store(scratch, at, fma(behind, load(scratch, FINAL + vector * LANES), load(scratch, at)))
    for k in range(-1, len(background)):
        plane = SHADE + k * TILE_PIXELS  # FINAL lies before the first channel
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


@kernel
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
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        open_tile(scratch, across, rows)
        for at in range(0, TILE_PIXELS, LANES):
            store(scratch, FINAL + at, splat(F(1)))
        for at in range(0, channels * TILE_PIXELS, LANES):
            store(scratch, SHADE + at, zeros())
        entry, end, any_open = start[tile], start[tile + 1], True
        while entry < end and any_open:
            count = min(BATCH, end - entry)
            all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
            any_open = False
            for vector in range(TILE_VECTORS):
                if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                    any_open = True
                    word = touching(vector, scratch) & all_of_them
                    if word != 0:
                        blend_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), channels, scratch)
            if any_open:
                entry += count
        done[tile] = entry
        write_tile(scratch, background, image, transmittance, left, top, across, rows, width, height)
