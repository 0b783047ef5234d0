"""Section `Counts`: how many Gaussians each triangle carries, in place of n triangle indices.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.reading import ByteReader

__all__ = ["decode_counts", "encode_counts"]

BY_CURVE, BY_FACE = 0, 1


def encode_counts(counts: Int[np.ndarray, " f"], order: Int[np.ndarray, " f"]) -> bytes:
    """Code the number of Gaussians of every triangle.

    Args:
        counts: in coding order.
        order: triangle at each place of the coding order. Counts are sent in that order or in the order of the head's faces, in which
            subdivision leaves regular traces: whichever is shorter.
    """
    parts = []
    for sequence in (counts, counts[np.argsort(order)]):
        coder = AdaptiveEncoder(1, expected=len(counts))
        coder.write(sequence, np.zeros(len(counts), np.int64))
        parts.append(coder.finish())
    by_face = len(parts[1]) < len(parts[0])
    return bytes([BY_FACE if by_face else BY_CURVE]) + parts[by_face]


def decode_counts(reader: ByteReader, order: Int[np.ndarray, " f"], n_gaussians: int) -> Int[np.ndarray, " f"]:
    """Read the number of Gaussians of every triangle, in coding order.

    Raises:
        FormatError: a count is negative, or they do not add up to `n_gaussians`.
    """
    (sequence,) = reader.unpack("B")
    if sequence not in (BY_CURVE, BY_FACE):
        raise reader.error(f"counts in order {sequence}, expected {BY_CURVE} or {BY_FACE}")
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(reader.left), 1, expected=len(order), offset=offset)
    counts = coder.read(np.zeros(len(order), np.int64))
    coder.check_end()
    if counts.min(initial=0) < 0 or counts.max(initial=0) > n_gaussians or counts.sum() != n_gaussians:
        raise reader.error(f"counts run from {counts.min(initial=0)} and add up to {counts.sum()}, not {n_gaussians}")
    return counts[order] if sequence == BY_FACE else counts
