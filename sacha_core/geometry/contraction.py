"""Sums of products over an axis that may be empty."""

from __future__ import annotations

import numpy as np
from jaxtyping import Shaped

__all__ = ["contract"]


def contract(
    subscripts: str, first: Shaped[np.ndarray, "..."], second: Shaped[np.ndarray, "..."]
) -> Shaped[np.ndarray, "..."]:
    """Give `numpy.einsum` of two arrays; zeros where nothing is summed.

    There, `numpy.einsum` multiplies its sum by a number from behind the empty array, and all is NaN where that happens to be infinite or
    none (seen in NumPy 1.26 and 2.4 where an empty array's stride is 0, as `numpy.zeros(0)` has it).

    Args:
        subscripts: as `numpy.einsum` has them, with an arrow and without an ellipsis.
        first: array with an axis for each of its letters.
        second: likewise.

    Returns:
        array with an axis for each letter behind the arrow.
    """
    if first.size and second.size:
        return np.asarray(np.einsum(subscripts, first, second))
    given, wanted = subscripts.split("->")
    sizes = dict(zip(given.replace(",", ""), first.shape + second.shape, strict=True))
    return np.zeros([sizes[letter] for letter in wanted], np.result_type(first, second))
