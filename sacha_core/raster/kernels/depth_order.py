"""Second stage: sort the Gaussians by depth."""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import within

DIGIT = 11
BUCKETS = 1 << DIGIT
PASSES = 3
INFINITE = np.uint32(0x7F800000)


@within
def distribute(source, target, n, depth_bits, digit, histogram):
    """Move `n` indices to where the digit of their depth belongs; `histogram` holds how many there are of each."""
    shift, base = np.uint32(digit * DIGIT), digit * BUCKETS
    total = 0
    for bucket in range(base, base + BUCKETS):
        here = histogram[bucket]
        histogram[bucket] = total
        total += here
    for k in range(n):
        g = source[k]
        bucket = base + ((depth_bits[g] >> shift) & np.uint32(BUCKETS - 1))
        target[histogram[bucket]] = g
        histogram[bucket] += 1


@kernel
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

    Source: least significant digit first radix sort, three digits of 11 bits.
    """
    for bucket in range(PASSES * BUCKETS):
        histogram[bucket] = 0
    seen = 0
    for g in range(n):
        bits = depth_bits[g]
        if bits < INFINITE:
            for digit in range(PASSES):
                histogram[digit * BUCKETS + ((bits >> np.uint32(digit * DIGIT)) & np.uint32(BUCKETS - 1))] += 1
            swap[seen] = g
            seen += 1
    distribute(swap, order, seen, depth_bits, 0, histogram)
    distribute(order, swap, seen, depth_bits, 1, histogram)
    distribute(swap, order, seen, depth_bits, 2, histogram)
    return seen
