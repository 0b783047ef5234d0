"""Memory that is used again and again: kept from call to call, so that drawing does not wait for it, and in large pages.

Whoever goes through tens of megabytes at every frame also goes through the table of its pages. NumPy asks the system for large pages where
an array has 4 MiB; here smaller arrays get them, too, by lying in blocks of that size. It changes no result, and does nothing where the
system has no such pages.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import DTypeLike

__all__ = ["Buffers", "together"]

Name = TypeVar("Name", bound=Hashable)
LINE = 64  # bytes of a cache line
BLOCK = 8 << 20  # bytes that small arrays share
OWN_BLOCK = 2 << 20  # bytes from which an array has a block of its own
LEAST = 4 << 20  # bytes for which NumPy asks for large pages
PAGE = 2 << 20  # bytes of a large page


class Buffers:
    """Named flat arrays that grow as needed; each begins at a cache line."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}
        self._block = np.zeros(0, np.uint8)  # what is left of it

    def space(self, name: str, size: int, dtype: DTypeLike) -> np.ndarray:
        """Give `size` elements under this name; what they hold is left over from before."""
        array = self._arrays.get(name)
        if array is None or len(array) < size:
            array = self._cut(size + size // 4, 0 if array is None else 2 * len(array), np.dtype(dtype))
            self._arrays[name] = array
        return array[:size]

    def _cut(self, size: int, doubled: int, dtype: np.dtype) -> np.ndarray:
        """Give new memory; where it comes from a block, of twice the old size, since the old is lost until the block is."""
        if max(size, doubled) * dtype.itemsize > OWN_BLOCK:
            return block(size * dtype.itemsize)[: size * dtype.itemsize].view(dtype)
        wanted = max(size, doubled) * dtype.itemsize
        whole = -(-wanted // LINE) * LINE
        if len(self._block) < whole:
            self._block = block(BLOCK)
        taken, self._block = self._block[:wanted], self._block[whole:]
        return taken.view(dtype)


def together(arrays: Mapping[Name, np.ndarray]) -> dict[Name, np.ndarray]:
    """Give copies, contiguous, that lie in one block; each begins at a cache line."""
    sizes = {name: -(-array.nbytes // LINE) * LINE for name, array in arrays.items()}
    memory, at = block(sum(sizes.values())), 0
    copies: dict[Name, np.ndarray] = {}
    for name, array in arrays.items():
        copies[name] = memory[at : at + array.nbytes].view(array.dtype).reshape(array.shape)
        copies[name][...] = array
        at += sizes[name]
    return copies


def block(size: int) -> np.ndarray:
    """Give at least so many bytes, zeros, that begin where a large page does."""
    raw = np.zeros(max(size + PAGE, LEAST), np.uint8)
    skip = -raw.ctypes.data % PAGE
    return raw[skip:]
