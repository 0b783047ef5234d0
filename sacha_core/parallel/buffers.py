"""Arrays that are kept from call to call, so that drawing does not wait for fresh memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

__all__ = ["Buffers"]

LINE = 64  # bytes of a cache line


class Buffers:
    """Named flat arrays that grow as needed; each begins at a cache line."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def space(self, name: str, size: int, dtype: DTypeLike) -> np.ndarray:
        """Give `size` elements under this name; what they hold is left over from before."""
        array = self._arrays.get(name)
        if array is None or len(array) < size:
            array = aligned(size + size // 4, np.dtype(dtype))
            self._arrays[name] = array
        return array[:size]


def aligned(size: int, dtype: np.dtype) -> np.ndarray:
    """Give an array of zeros that begins at a cache line."""
    raw = np.zeros(size * dtype.itemsize + LINE, np.uint8)
    skip = -raw.ctypes.data % LINE
    return raw[skip : skip + size * dtype.itemsize].view(dtype)
