"""Section `Hidden`: how little of each Gaussian is seen, so that what lies behind others gets coarse steps.

Opacity, size and shape do not tell how much of a Gaussian others cover. Where an encoder has measured it, a class for each Gaussian says
so, coded like an attribute; where it has not, all classes are 0.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.codec.order import Layout
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_HIDDEN

__all__ = ["decode_hidden", "encode_hidden"]

NONE, GIVEN = 0, 1


def encode_hidden(layout: Layout, hidden: Int[np.ndarray, " n"]) -> bytes:
    """Code classes from 0 to `MAX_HIDDEN`."""
    if not hidden.any():
        return bytes([NONE])
    return bytes([GIVEN]) + encode_predicted(layout, hidden[:, None], np.ones((len(hidden), 1), np.int64))[0]


def decode_hidden(reader: ByteReader, layout: Layout) -> Int[np.ndarray, " n"]:
    """Read classes.

    Raises:
        FormatError: a class is out of range, or the bytes are not what an encoder writes.
    """
    n = len(layout.slots)
    (given,) = reader.unpack("B")
    if given not in (NONE, GIVEN):
        raise reader.error(f"classes of kind {given}, expected {NONE} (none) or {GIVEN}")
    if given == NONE:
        reader.check_end()
        return np.zeros(n, np.int64)
    hidden = decode_predicted(reader, layout, np.ones((n, 1), np.int64), 1)[:, 0]
    if hidden.min(initial=0) < 0 or hidden.max(initial=0) > MAX_HIDDEN:
        raise reader.error(f"a class outside 0 to {MAX_HIDDEN}")
    return hidden
