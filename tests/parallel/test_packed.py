"""Packed arguments: kernels get from them what they get when they are handed the tuple itself."""

from __future__ import annotations

import gc
import sys

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.packed import Packed, unpacked


@kernel
def written(value, factor):
    """Write to the arrays of a tuple, and give a number that all of it goes into."""
    (flat, table), whole, (flag, marks), single = value
    for row in range(len(table)):
        flat[row] = factor * table[row, 1] + whole
    total = single * table.size + marks[1]
    return total if flag else -total


@kernel
def written_packed(packed, factor):
    """Do so with what was packed."""
    return written(unpacked(packed), factor)


def material(flag: bool = True, dtype: type[np.floating] = np.float32):
    table = np.arange(12, dtype=dtype).reshape(4, 3)[:, ::-1]
    return (np.zeros(4, np.float64), table), 7, (flag, np.array([3, 5], np.uint8)), np.float32(0.25)


def test_kernels_get_the_tuple_itself() -> None:
    for flag in (True, False):
        for dtype in (np.float32, np.float64):
            given, handed_over = material(flag, dtype), material(flag, dtype)
            packed = Packed(given)
            assert written_packed(packed.table, 2.5) == written(handed_over, 2.5)
            assert np.array_equal(given[0][0], handed_over[0][0])
            assert given[0][0].any()


def test_numbers_are_those_of_then_and_arrays_those_of_now() -> None:
    given = material()
    packed = Packed(given)
    before = written_packed(packed.table, 1.0)
    given[2][1][1] += 1
    assert written_packed(packed.table, 1.0) == before + 1


def test_arrays_live_as_long_as_what_they_are_packed_in() -> None:
    """Memory that was given back would soon be somebody else's."""
    expected = written(material(), 3.0)
    packed = [Packed(material()) for _ in range(50)]
    gc.collect()
    others = [np.full(12, np.nan, np.float32) for _ in range(500)]
    assert all(written_packed(each.table, 3.0) == expected for each in packed)
    assert len(others) == 500


def test_nobody_counts_owners_of_packed_arrays() -> None:
    """Else memory would go, or stay, with the number of calls."""
    given = material()
    packed = Packed(given)
    owners = [sys.getrefcount(array) for array in given[0]]
    for _ in range(10):
        written_packed(packed.table, 1.0)
    assert [sys.getrefcount(array) for array in given[0]] == owners
