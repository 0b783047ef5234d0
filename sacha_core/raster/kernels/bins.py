"""Second stage: sort the visible Gaussians by depth and deal their entries out to the tiles."""

from __future__ import annotations

import numpy as np
from numba import njit

from sacha_core.raster.kernels.layout import KEY_ROW, KEY_TILE, TILE_HEIGHT, TILE_WIDTH

DIGIT = 11
BUCKETS = 1 << DIGIT
PASSES = 3
ROWS = (1 << KEY_TILE) - 1
LAST_ROW = (1 << KEY_ROW) - 1


@njit(cache=True, nogil=True)
def sort_by_depth(depth_bits, count, order, swap, histogram):
    """Sort the Gaussians that have entries, front to back; equal depths stay in their order. Gives how many there are.

    Args:
        depth_bits: (n,) uint32 bits of positive float32 depths, which order as the depths do.
        count: (n,) entries of each Gaussian.
        order: (n,) result, indices.
        swap: (n,) space.
        histogram: (3 x 2048,) space.
    """
    histogram[:] = 0
    visible = 0
    for g in range(len(count)):
        if count[g] > 0:
            bits = depth_bits[g]
            for digit in range(PASSES):
                histogram[digit * BUCKETS + ((bits >> np.uint32(digit * DIGIT)) & np.uint32(BUCKETS - 1))] += 1
            order[visible] = g
            visible += 1
    source, target = order, swap
    for digit in range(PASSES):
        shift, base, total = np.uint32(digit * DIGIT), digit * BUCKETS, 0
        for bucket in range(BUCKETS):
            total, histogram[base + bucket] = total + histogram[base + bucket], total
        for k in range(visible):
            g = source[k]
            bucket = base + ((depth_bits[g] >> shift) & np.uint32(BUCKETS - 1))
            target[histogram[bucket]] = g
            histogram[bucket] += 1
        source, target = target, source
    order[:visible] = source[:visible]
    return visible


@njit(cache=True, nogil=True)
def deal(order, visible, first, count, keys, n_tiles, start, cursor, owner, origin):
    """Deal entries out to tiles, front to back within each.

    Args:
        order: (n,) Gaussians by depth.
        visible: how many of them there are.
        first: (n,) position of a Gaussian's first key.
        count: (n,) number of its keys.
        keys: emitted keys.
        n_tiles: number of tiles.
        start: (n_tiles + 1,) result: first entry of each tile.
        cursor: (n_tiles,) space.
        owner: result, of each entry: Gaussian << 10 | first row << 5 | last row.
        origin: result, of each entry: where its key was.
    """
    start[:] = 0
    for k in range(visible):
        g = order[k]
        for i in range(first[g], first[g] + count[g]):
            start[(keys[i] >> KEY_TILE) + 1] += 1
    for tile in range(n_tiles):
        start[tile + 1] += start[tile]
        cursor[tile] = start[tile]
    for k in range(visible):
        g = order[k]
        for i in range(first[g], first[g] + count[g]):
            tile = keys[i] >> KEY_TILE
            entry = cursor[tile]
            cursor[tile] = entry + 1
            owner[entry] = np.int64(g) << KEY_TILE | (keys[i] & ROWS)
            origin[entry] = i


@njit(cache=True, nogil=True)
def key_bounds(keys, columns):
    """Give left, top, right and bottom, in pixels, of what at least one key touches."""
    left, top, right, bottom = 1 << 30, 1 << 30, 0, 0
    for key in keys:
        tile = key >> KEY_TILE
        x, y = tile % columns * TILE_WIDTH, tile // columns * TILE_HEIGHT
        left, right = min(left, x), max(right, x + TILE_WIDTH)
        top, bottom = min(top, y + ((key & ROWS) >> KEY_ROW)), max(bottom, y + (key & LAST_ROW) + 1)
    return left, top, right, bottom
