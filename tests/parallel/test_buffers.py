"""Memory that is used again: it is there, apart, on cache lines, and in as few pieces as is said."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sacha_core.parallel import buffers
from sacha_core.parallel.buffers import BLOCK, LINE, OWN_BLOCK, Buffers, together


def extent(array: np.ndarray) -> tuple[int, int]:
    return array.ctypes.data, array.ctypes.data + array.nbytes


def apart(arrays: list[np.ndarray]) -> bool:
    ends = sorted(map(extent, arrays))
    return all(end <= start for (_, end), (start, _) in pairwise(ends))


def test_arrays_under_different_names_are_apart_and_begin_at_cache_lines() -> None:
    some = Buffers()
    sizes = [1, 5, 17, 1000, OWN_BLOCK // 8, OWN_BLOCK, 3]
    arrays = [some.space(f"array {k}", size, np.float32) for k, size in enumerate(sizes)]
    assert [len(array) for array in arrays] == sizes
    assert all(array.ctypes.data % LINE == 0 and not array.any() for array in arrays)
    assert apart(arrays)


def test_a_name_keeps_its_memory_until_it_wants_more_and_then_leaves_the_old_alone() -> None:
    some = Buffers()
    first = some.space("array", 100, np.int64)
    first[:] = np.arange(100)
    assert some.space("array", 60, np.int64).ctypes.data == first.ctypes.data
    more = some.space("array", 100_000, np.int64)
    more[:] = -1
    assert apart([first, more])
    assert np.array_equal(first, np.arange(100))


def test_an_array_that_grows_step_by_step_wastes_no_more_than_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    block = buffers.block
    monkeypatch.setattr(buffers, "block", lambda size: made.append(size) or block(size))
    some, size = Buffers(), 1000
    while 4 * size < OWN_BLOCK // 4:
        some.space("array", size, np.float32)
        size += size // 20
    assert made == [BLOCK]


def test_copies_that_lie_together_are_equal_contiguous_and_in_one_piece() -> None:
    rng = np.random.default_rng(0)
    arrays = {
        "a": rng.normal(size=(7, 3, 5)).astype(np.float32)[::2],
        "b": rng.integers(0, 9, 11),
        ("c", 1): np.zeros((0, 4), np.float32),
    }
    copies = together(arrays)
    assert list(copies) == list(arrays)
    for name, array in arrays.items():
        assert np.array_equal(copies[name], array)
        assert (copies[name].dtype, copies[name].shape) == (array.dtype, array.shape)
        assert copies[name].flags.c_contiguous
        assert not np.shares_memory(copies[name], array)
    assert apart([copies["a"], copies["b"]])
    assert extent(copies["b"])[0] - extent(copies["a"])[1] < LINE
