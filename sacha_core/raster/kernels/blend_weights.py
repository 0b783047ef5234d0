"""The importance pass: blending weights summed over pixels, without the geometry's gradients."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import (
    LANES,
    inlined,
    load,
    lowest_bit,
    maximum,
    some,
    splat,
    store,
    sums,
    zeros,
)
from sacha_core.raster.kernels.batch import (
    ALPHA,
    BATCH,
    FADED,
    RUN,
    let_through,
    open_tile,
    prepare,
    touching,
    write_alphas,
)
from sacha_core.raster.kernels.blend_backward import SUM, SUMS, UPSTREAM, add_product_to, clear_sums, load_tile
from sacha_core.raster.kernels.layout import (
    RECORD,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)


@inlined
def load_weights(pixel_weights, most, top, left, width, height, across, rows, scratch, planes):
    """Copy a tile's part of the images of pixel weights into planes of the scratch, up to `most`; zeros where there are fewer."""
    for k in range(most):
        plane = planes + k * TILE_PIXELS
        if k * height * width < len(pixel_weights):
            corner = (k * height + top) * width + left
            load_tile(pixel_weights, corner, width, across, rows, scratch, plane)
        else:
            for at in range(0, TILE_PIXELS, LANES):
                store(scratch, plane + at, zeros())


@inlined
def weigh_vector(word, vector, y, scratch):
    """Add the weights of one vector of the tile, times its pixels' weights, to the sums of the entries that `word` names."""
    write_alphas(word, y, scratch)
    pixel = vector * LANES
    run = load(scratch, RUN + pixel)
    alpha_at = ALPHA
    while word != 0:
        at = SUMS + lowest_bit(word) * SUM
        word &= word - 1
        weight, run, _ = let_through(load(scratch, alpha_at), run)
        alpha_at += LANES
        for part in range(4):
            add_product_to(scratch, at + part * LANES, weight, load(scratch, UPSTREAM + part * TILE_PIXELS + pixel))
    store(scratch, RUN + pixel, maximum(run, splat(FADED)))


@kernel
def blend_weights(
    first_tile, last_tile, start, done, entries, records, x_lanes, y_lanes, pixel_weights, width, height, entry_sums, scratch
):  # fmt: skip
    """Sum, for every entry, the blending weight times up to four images of pixel weights, flat; arguments as of `blend_backward`."""
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        for e in range(done[tile], start[tile + 1]):
            store(entry_sums, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
        entry, end = start[tile], done[tile]
        if entry == end:
            continue
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        open_tile(scratch, across, rows)
        load_weights(pixel_weights, 4, top, left, width, height, across, rows, scratch, UPSTREAM)
        while entry < end:
            count = min(BATCH, end - entry)
            all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
            clear_sums(entry, count, 4, entries, entry_sums, scratch)
            for vector in range(TILE_VECTORS):
                if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                    word = touching(vector, scratch) & all_of_them
                    if word != 0:
                        weigh_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), scratch)
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
