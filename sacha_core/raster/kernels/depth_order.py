"""Second stage: sort the Gaussians by depth."""

from __future__ import annotations

import numpy as np
from numba import njit

DIGIT = 11
BUCKETS = 1 << DIGIT
PASSES = 3
INFINITE = np.uint32(0x7F800000)


@njit(cache=True, nogil=True)
def sort_by_depth(depth_bits, n, order, swap, histogram):
    """Sort Gaussians front to back, those left out whose depth is infinite; equal depths stay in their order.

    Args:
        depth_bits: uint32 bits of positive float32 depths, which order as the depths do.
        n: number of Gaussians.
        order: (n,) result, indices.
        swap: (n,) space.
        histogram: (3 x 2048,) space.

    Returns:
        How many were sorted.
    """
    histogram[:] = 0
    visible = 0
    for g in range(n):
        bits = depth_bits[g]
        if bits < INFINITE:
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
