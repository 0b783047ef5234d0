"""How much of a picture each Gaussian makes up: blending weights summed over pixels, without drawing it."""

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
from sacha_core.raster.kernels.blend_backward import SUM, SUMS, add_to, clear_sums
from sacha_core.raster.kernels.layout import (
    RECORD,
    TILE_HEIGHT,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)


@inlined
def cover_vector(word, vector, y, scratch):
    """Add the weights of one vector of the tile to the sums of the entries that `word` names."""
    write_alphas(word, y, scratch)
    run = load(scratch, RUN + vector * LANES)
    alpha_at = ALPHA
    while word != 0:
        at = SUMS + lowest_bit(word) * SUM
        word &= word - 1
        weight, run, _ = let_through(load(scratch, alpha_at), run)
        alpha_at += LANES
        add_to(scratch, at, weight)
    store(scratch, RUN + vector * LANES, maximum(run, splat(FADED)))


@kernel
def blend_cover(first_tile, last_tile, start, entries, records, x_lanes, y_lanes, width, height, entry_sums, scratch):
    """Write, for every entry, the sum of its blending weights to the first of its numbers; arguments as of `blend_backward`."""
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        open_tile(scratch, across, rows)
        entry, end, any_open = start[tile], start[tile + 1], True
        while entry < end and any_open:
            count = min(BATCH, end - entry)
            all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
            clear_sums(entry, count, 1, entries, entry_sums, scratch)
            any_open = False
            for vector in range(TILE_VECTORS):
                if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                    any_open = True
                    word = touching(vector, scratch) & all_of_them
                    if word != 0:
                        cover_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), scratch)
            for k in range(count):
                total = sums((load(scratch, SUMS + k * SUM),))
                store(entry_sums, (entries[entry + k] >> TOP_SHIFT) * RECORD, total)
            entry += count
        for e in range(entry, end):
            store(entry_sums, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
