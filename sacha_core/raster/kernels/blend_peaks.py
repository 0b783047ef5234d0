"""The largest blending weight that a Gaussian has in any pixel: the blending repeated, without colours."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import LANES, inlined, load, lowest_bit, maximum, some, splat, store, zeros
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
from sacha_core.raster.kernels.blend_backward import SUM, SUMS, clear_sums
from sacha_core.raster.kernels.layout import (
    RECORD,
    TILE_HEIGHT,
    TILE_VECTORS,
    TILE_WIDTH,
    TOP_SHIFT,
    TRANSMITTANCE_MIN,
)


@inlined
def raise_vector(word, vector, y, scratch):
    """Raise the peaks of the entries that `word` names to their weights in one vector of the tile."""
    write_alphas(word, y, scratch)
    run = load(scratch, RUN + vector * LANES)
    alpha_at = ALPHA
    while word != 0:
        at = SUMS + lowest_bit(word) * SUM
        word &= word - 1
        weight, run, _ = let_through(load(scratch, alpha_at), run)
        alpha_at += LANES
        store(scratch, at, maximum(load(scratch, at), weight))
    store(scratch, RUN + vector * LANES, maximum(run, splat(FADED)))


@kernel
def blend_peaks(
    first_tile, last_tile, start, done, entries, records, x_lanes, y_lanes, width, height, entry_peaks, scratch
):
    """Write, for every entry, the largest weight in each lane to its sixteen numbers; arguments as of `blend_backward`."""
    columns = len(x_lanes) // LANES
    for tile in range(first_tile, last_tile):
        for e in range(done[tile], start[tile + 1]):
            store(entry_peaks, (entries[e] >> TOP_SHIFT) * RECORD, zeros())
        top, left = tile // columns * TILE_HEIGHT, tile % columns * TILE_WIDTH
        rows, across = min(TILE_HEIGHT, height - top), min(TILE_WIDTH, width - left)
        x_tile, y_tile = load(x_lanes, tile % columns * LANES), tile // columns * TILE_VECTORS
        open_tile(scratch, across, rows)
        entry, end = start[tile], done[tile]
        while entry < end:
            count = min(BATCH, end - entry)
            all_of_them = prepare(entry, count, entries, records, x_tile, scratch)
            clear_sums(entry, count, 1, entries, entry_peaks, scratch)
            for vector in range(TILE_VECTORS):
                if some(load(scratch, RUN + vector * LANES) > splat(TRANSMITTANCE_MIN)):
                    word = touching(vector, scratch) & all_of_them
                    if word != 0:
                        raise_vector(word, vector, load(y_lanes, (y_tile + vector) * LANES), scratch)
            for k in range(count):
                store(entry_peaks, (entries[entry + k] >> TOP_SHIFT) * RECORD, load(scratch, SUMS + k * SUM))
            entry += count


@kernel
def gather_peaks(start, stop, span, entry_peaks, peaks):
    """Write the largest number of the entries of the Gaussians `start` to `stop` to `peaks` (n,)."""
    for g in range(start, stop):
        largest = np.float32(0)
        for e in range(span[2 * g] * RECORD, (span[2 * g] + span[2 * g + 1]) * RECORD):
            largest = max(largest, entry_peaks[e])
        peaks[g] = largest
