"""What blending, its gradient and the sums of weights share: a tile's entries, batch by batch, laid out for its vectors.

The natural order, entry after entry, each over its few vectors of pixels, keeps a tile's state in memory and ends in a mispredicted branch
at every entry. Here a batch of entries is prepared once; then each vector of the tile goes through those of them that touch it, front to
back, with its state in registers. Each pixel sees the same operations in the same order.

The arithmetic of a vector is split into two loops, because a processor looks only so many instructions ahead: the first computes the
alphas, which do not depend on one another, the second lets the light pass through them.
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.lanes import (
    LANES,
    bits,
    fma,
    inlined,
    load,
    load_bits,
    load_spread,
    lowest_bit,
    minimum,
    prefetch,
    select,
    splat,
    store,
    zeros,
)
from sacha_core.raster.kernels.layout import (
    ALPHA_MAX,
    GAUSSIAN_MASK,
    GAUSSIAN_SHIFT,
    POWER_MIN,
    R_A,
    R_B,
    R_C,
    R_OPACITY,
    R_X,
    R_Y,
    RECORD,
    ROW_BITS,
    ROW_MASK,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
    TRANSMITTANCE_MIN,
)

F = np.float32
BATCH = 64  # entries, one for each bit of an integer
LOOK_AHEAD = 2 * BATCH  # so far beyond the last entry one may look
FADED = F(1e-30)  # far below where a pixel is closed, and far above where numbers become denormal, and arithmetic slow

# the scratch: a plane of transmittance, what was prepared of the batch, and the alphas of one vector
RUN = 0
ACROSS = TILE_PIXELS
SLOPE = ACROSS + BATCH * LANES
COPY = SLOPE + BATCH * LANES
FIRST = COPY + BATCH * RECORD
LAST = FIRST + BATCH
ALPHA = LAST + BATCH
BATCH_SCRATCH = ALPHA + BATCH * LANES

# 2^x on [-1, 0] by Chebyshev interpolation of degree 5; relative error 8e-8
E0, E1, E2, E3, E4, E5 = (
    F(c)
    for c in np.polynomial.chebyshev.Chebyshev.interpolate(np.exp2, 5, domain=[-1, 0])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)


@inlined
def alpha_power(power):
    """Give 2^(8 power) for power in [-1, 0], growing on above; relative error below 1e-6. Below -1 it is anything, even infinite."""
    y = fma(splat(E5), power, splat(E4))
    y = fma(fma(fma(fma(y, power, splat(E3)), power, splat(E2)), power, splat(E1)), power, splat(E0))
    y = y * y
    y = y * y
    return y * y


@inlined
def open_tile(scratch, across, rows):
    """Set a tile's transmittance: 1 in the image, 0 outside."""
    if across == TILE_WIDTH and rows == TILE_HEIGHT:
        for at in range(0, TILE_PIXELS, LANES):
            store(scratch, RUN + at, splat(F(1)))
    else:
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                scratch[RUN + y * TILE_WIDTH + x] = F(1) if x < across and y < rows else F(0)


@inlined
def prepare(entry, count, entries, records, x_tile, scratch):
    """Lay out `count` entries from `entry` on: their records, and the parts of their powers that depend on x alone.

    Gives an integer whose lowest `count` bits are set.
    """
    for k in range(0, BATCH, LANES):
        store(scratch, FIRST + k, load_bits(entries, entry + k, ROW_BITS + 1, ROW_MASK >> 1))
        store(scratch, LAST + k, load_bits(entries, entry + k, 1, ROW_MASK >> 1))
    for k in range(count):
        prefetch(records, ((entries[entry + k + BATCH] >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD)
        at = ((entries[entry + k] >> GAUSSIAN_SHIFT) & GAUSSIAN_MASK) * RECORD
        dx = x_tile - load_spread(records, at + R_X)
        across = fma(load_spread(records, at + R_A) * dx, dx, load_spread(records, at + R_OPACITY))
        store(scratch, ACROSS + k * LANES, across)
        store(scratch, SLOPE + k * LANES, load_spread(records, at + R_B) * dx)
        store(scratch, COPY + k * RECORD, load(records, at))
    return np.int64(-1) if count == BATCH else (np.int64(1) << count) - 1


@inlined
def touching(vector, scratch):
    """Which entries of the batch touch a vector of the tile? Bit k for the k-th; beyond the last, any."""
    here = splat(F(vector))
    word = np.int64(0)
    for k in range(0, BATCH, LANES):
        word |= bits((load(scratch, FIRST + k) <= here) & (load(scratch, LAST + k) >= here)) << k
    return word


@inlined
def write_alphas(word, y, scratch):
    """Write the alphas, at the pixels of one vector, of the entries that `word` names, one after the other."""
    at = ALPHA
    while word != 0:
        k = lowest_bit(word)
        word &= word - 1
        dy = y - load_spread(scratch, COPY + k * RECORD + R_Y)
        slope = fma(load_spread(scratch, COPY + k * RECORD + R_C), dy, load(scratch, SLOPE + k * LANES))
        power = fma(slope, dy, load(scratch, ACROSS + k * LANES))
        alpha = minimum(alpha_power(power), splat(ALPHA_MAX))
        store(scratch, at, select(power >= splat(POWER_MIN), alpha, zeros()))
        at += LANES


@inlined
def let_through(alpha, run):
    """Let light pass one more Gaussian.

    Gives the blending weight, the transmittance behind, and which pixels are still open. A pixel closes before the transmittance would
    fall to 1e-4, and what closes it has no weight; its transmittance goes on falling, so it cannot open again.
    """
    weight = alpha * run
    run = run - weight
    open_ = run > splat(TRANSMITTANCE_MIN)
    return select(open_, weight, zeros()), run, open_
