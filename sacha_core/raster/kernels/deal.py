"""Second stage, second part: deal the keys of the Gaussians, in order of depth, out to the tiles."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import prefetch
from sacha_core.raster.kernels.layout import GAUSSIAN_SHIFT, KEY_BITS, TOP_SHIFT

AHEAD = 16  # Gaussians whose keys are asked for in advance
KEY_MASK = (1 << KEY_BITS) - 1
TILE_COST = 8  # entries that take as long as a tile's first and last steps


@kernel
def count_up(histograms, start, front, back):
    """Sum the jobs' histograms (jobs, tiles) up: `start` and `front` get each tile's first entry, `back` its last; give their number."""
    total = np.int64(0)
    jobs, tiles = histograms.shape
    for tile in range(tiles):
        start[tile] = total
        front[tile] = total
        for job in range(jobs):
            total += histograms[job, tile]
        back[tile] = total - 1
    start[tiles] = total
    return total


@kernel
def share_out(start, jobs, bounds):
    """Write the bounds of ranges of tiles with about equal numbers of entries to `bounds` (jobs + 1,)."""
    tiles = len(start) - 1
    total = start[tiles] + tiles * TILE_COST
    tile = 0
    for job in range(jobs):
        while (start[tile] + tile * TILE_COST) * jobs < total * job:
            tile += 1
        bounds[job] = tile
    bounds[jobs] = tiles


@kernel
def deal(order, first, stop, step, span, keys, first_tile, last_tile, cursor, entries):
    """Deal out the keys of some Gaussians.

    Where one job fills the tiles from their first entry on with the nearer half, and another from their last entry back with the
    farther half, from the back to the front, nobody has to count how many keys of a tile are in which half.

    Args:
        order: Gaussians by depth.
        first: place in `order` of the first to deal.
        stop: where to stop.
        step: 1 for front to back, -1 for back to front.
        span: (n, 2) flat, see `project`.
        keys: see `project`.
        first_tile: the keys of other tiles are left alone.
        last_tile: end of the range of tiles.
        cursor: (tiles,) where each tile's next entry goes.
        entries: result, see `layout`.
    """
    ahead = step * AHEAD
    for k in range(first, stop, step):
        if (stop - k) * step > 2 * AHEAD:
            prefetch(span, 2 * order[k + 2 * ahead])
            prefetch(keys, span[2 * order[k + ahead]])
        g = np.int64(order[k])
        at = np.uint64(span[2 * g])  # indices without a sign need no look at whether they count from the end
        end = at + np.uint64(span[2 * g + 1])
        while at < end:
            key = keys[at]
            tile = np.uint64(key >> KEY_BITS)
            if first_tile <= np.int64(tile) < last_tile:
                place = cursor[tile]
                entries[np.uint64(place)] = np.int64(at) << TOP_SHIFT | g << GAUSSIAN_SHIFT | (key & KEY_MASK)
                cursor[tile] = place + step
            at += np.uint64(1)
