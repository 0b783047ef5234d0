"""Section `Counts`: how many Gaussians each triangle carries, in place of n triangle indices.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.reading import ByteReader

__all__ = ["decode_counts", "encode_counts"]


def encode_counts(counts: Int[np.ndarray, " f"]) -> bytes:
    """Code the number of Gaussians of every triangle, in the order of the head's faces."""
    coder = AdaptiveEncoder(1, expected=len(counts))
    coder.write(counts, np.zeros(len(counts), np.int64))
    return coder.finish()


def decode_counts(reader: ByteReader, n_faces: int, n_gaussians: int) -> Int[np.ndarray, " f"]:
    """Read the number of Gaussians of every triangle.

    Raises:
        FormatError: a count is negative, or they do not add up to `n_gaussians`.
    """
    offset = reader.offset
    coder = AdaptiveDecoder(reader.take(reader.left), 1, expected=n_faces, offset=offset)
    counts = coder.read(np.zeros(n_faces, np.int64))
    coder.check_end()
    if counts.min(initial=0) < 0 or counts.max(initial=0) > n_gaussians or counts.sum() != n_gaussians:
        raise reader.error(f"counts run from {counts.min(initial=0)} and add up to {counts.sum()}, not {n_gaussians}")
    return counts
