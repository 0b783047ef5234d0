"""Oracle: sums of products one element at a time; and memory behind empty arrays that is no number."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided

from sacha_core.geometry.contraction import contract

NO_NUMBER = np.full(256, np.nan, np.float32)


def test_sums_of_products() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(4, 3, 5)), rng.normal(size=5)
    wanted = [[sum(a * b for a, b in zip(row, second, strict=True)) for row in block] for block in first]
    np.testing.assert_allclose(contract("vcs,s->vc", first, second), wanted, rtol=1e-13)


@pytest.mark.parametrize("stride", [0, 4, 12])
def test_nothing_to_sum_is_zero_whatever_lies_behind(stride: int) -> None:
    second = as_strided(NO_NUMBER, (0,), (stride,))
    for strides in itertools.product((0, 4, 12), repeat=3):
        summed = contract("vcs,s->vc", as_strided(NO_NUMBER, (5, 3, 0), strides), second)
        assert summed.dtype == np.float32
        np.testing.assert_array_equal(summed, np.zeros((5, 3)))


def test_axes_are_those_behind_the_arrow() -> None:
    assert contract("pfg,pg->fp", np.zeros((2, 3, 0)), np.zeros((2, 0), np.float32)).shape == (3, 2)
