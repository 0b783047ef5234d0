"""Section `Static`: what is said once about the person: identity coefficients and personal vertex offsets.

Source: own.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.reading import ByteReader

__all__ = ["MAX_LEVEL", "decode_static", "encode_static", "read_step", "to_levels", "to_values"]

LAYOUT = "dd"  # step of the shape, step of the offsets (metres)
SHAPE_CONTEXT = 0
OFFSET_CONTEXTS = np.array([1, 2, 3])
N_CONTEXTS = 4
MAX_LEVEL = 1 << 30
SMALLEST_STEP, LARGEST_STEP = 1e-9, 1e3


def read_step(reader: ByteReader) -> float:
    """Read a quantiser step.

    Raises:
        FormatError: it is not a positive number of a sane size.
    """
    (step,) = reader.unpack("d")
    if not SMALLEST_STEP <= step <= LARGEST_STEP:
        raise reader.error(f"a step of {step}, expected {SMALLEST_STEP} to {LARGEST_STEP}")
    return float(step)


def to_levels(values: Float[np.ndarray, "..."], step: float) -> Int[np.ndarray, "..."]:
    """Give the nearest multiple of `step` to each value.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    levels = np.rint(values.astype(np.float64) / step)
    if np.abs(levels).max(initial=0) > MAX_LEVEL:
        raise OverflowError(f"{np.abs(values).max()} is more than 2**30 steps of {step}")
    return levels.astype(np.int64)


def to_values(levels: Int[np.ndarray, "..."], step: float) -> Float[np.ndarray, "..."]:
    """Give float32 values of multiples of `step`: one float64 product, rounded once."""
    return (levels.astype(np.float64) * step).astype(np.float32)


def encode_static(
    shape: Float[np.ndarray, " s"], static_offset: Float[np.ndarray, "v 3"], shape_step: float, offset_step: float
) -> bytes:
    """Code identity and offsets; each offset as its difference to the vertex before."""
    coder = AdaptiveEncoder(N_CONTEXTS, expected=shape.size + static_offset.size)
    coder.write(to_levels(shape, shape_step), np.full(shape.size, SHAPE_CONTEXT))
    offsets = to_levels(static_offset, offset_step)
    coder.write(np.diff(offsets, axis=0, prepend=0).reshape(-1), np.tile(OFFSET_CONTEXTS, len(offsets)))
    return struct.pack("<" + LAYOUT, shape_step, offset_step) + coder.finish()


def decode_static(
    reader: ByteReader, n_shape: int, n_offsets: int
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "v 3"]]:
    """Read identity and offsets.

    Raises:
        FormatError: a step or a value is out of range, or bytes are left over.
    """
    shape_step, offset_step = read_step(reader), read_step(reader)
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(reader.left), N_CONTEXTS, expected=n_shape + 3 * n_offsets, offset=offset)
    shape = coder.read(np.full(n_shape, SHAPE_CONTEXT))
    differences = coder.read(np.tile(OFFSET_CONTEXTS, n_offsets)).reshape(n_offsets, 3)
    coder.check_end()
    offsets = np.cumsum(differences, axis=0)
    if max(np.abs(shape).max(initial=0), np.abs(offsets).max(initial=0)) > MAX_LEVEL:
        raise reader.error(f"a value of more than {MAX_LEVEL} steps")
    return to_values(shape, shape_step), to_values(offsets, offset_step)
