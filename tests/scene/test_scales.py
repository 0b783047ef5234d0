"""Scales: what a ramp must do (order, ends, ties, whole numbers), and legends against the numbers they are of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.scene.palettes import MIDDLE, STEPS
from sacha_core.scene.scales import Kind, number_text, scale_of

MOST_LINES = 14  # a legend that is longer is not read


def test_more_gaussians_lie_further_along_and_none_stands_apart() -> None:
    count = np.arange(1000)
    scale = scale_of(count, "amount")
    levels = scale.levels(count)
    assert levels[0] == 0
    assert (levels[1], levels[-1]) == (1, STEPS)
    assert (np.diff(levels) >= 0).all()
    for number in (1, 2, 7, 40, 999):  # the definition: even steps of the logarithm
        assert levels[number] == 1 + round(math.log(number) / math.log(999) * (STEPS - 1))


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=50))
def test_every_count_has_a_colour_and_the_legend_reaches_it(counts: list[int]) -> None:
    count = np.array(counts)
    scale = scale_of(count, "amount")
    assert scale.ticks == sorted(set(scale.ticks))
    assert scale.ticks[-1] == count.max()
    assert (0 in scale.ticks) == (0 in counts)
    assert len(scale.ticks) <= MOST_LINES
    levels = scale.levels(count)
    assert levels.max() <= STEPS
    assert np.array_equal(levels == 0, count == 0)


@pytest.mark.parametrize("kind", ["amount", "level", "factor", "change"])
@given(values=st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=40))
def test_colours_keep_the_order_of_numbers_and_unknown_ones_have_their_own(kind: Kind, values: list[float]) -> None:
    numbers = np.array([*(values if kind in {"level", "change"} else map(abs, values)), np.nan], np.float32)
    scale = scale_of(numbers, kind)
    levels = scale.levels(numbers)
    assert levels[-1] == 0
    known = np.argsort(numbers[:-1], kind="stable")
    assert (np.diff(levels[known]) >= 0).all()
    assert levels.min() >= 0
    assert levels.max() <= STEPS
    assert 1 <= len(scale.ticks) <= MOST_LINES
    assert scale.ticks == sorted(scale.ticks)


def test_levels_run_evenly_from_the_least_to_the_largest() -> None:
    values = np.array([0.2, 0.4, 0.6])
    scale = scale_of(values, "level")
    assert scale.levels(values).tolist() == [1, 1 + 126 // 2, STEPS]
    assert (scale.ticks[0], scale.ticks[-1]) == (0.2, 0.6)


def test_factors_lie_around_one_as_far_up_as_down() -> None:
    values = np.array([0.5, 1.0, 2.0, 4.0])
    levels = scale_of(values, "factor").levels(values)
    assert levels[1] == MIDDLE
    assert levels[3] == STEPS
    assert levels[2] - MIDDLE == MIDDLE - levels[0]


def test_changes_lie_around_none_and_whole_ones_say_so() -> None:
    values = np.array([-300, -1, 0, 1, 40])
    scale = scale_of(values, "change")
    levels = scale.levels(values)
    assert (levels[0], levels[2]) == (1, MIDDLE)
    assert levels[3] - MIDDLE == MIDDLE - levels[1] > 0
    assert scale.ticks == [-300, -100, -10, -1, 0, 1, 10, 100, 300]
    assert scale.whole


def test_all_numbers_alike_still_have_a_colour_and_a_legend() -> None:
    for kind in ("amount", "level", "factor", "change"):
        scale = scale_of(np.full(3, 0.7), kind)  # type: ignore[arg-type]
        assert (scale.levels(np.full(3, 0.7)) > 0).all()
        assert scale.ticks
        empty = scale_of(np.full(3, np.nan), kind)  # type: ignore[arg-type]
        assert (empty.levels(np.full(3, np.nan)) == 0).all()


@pytest.mark.parametrize(
    ("value", "whole", "text"),
    [
        (1234.0, True, "1,234"), (0.0, True, "0"), (12345.6, False, "12,346"), (0.1234, False, "0.123"), (1.0, False, "1.00"),
        (2e-7, False, "2.00e-07"), (float("nan"), False, "-"),
    ],
)  # fmt: skip
def test_numbers_are_written_for_people(value: float, whole: bool, text: str) -> None:
    assert number_text(value, whole) == text


def test_a_few_far_numbers_do_not_take_the_ramp_for_themselves() -> None:
    values = np.concatenate([np.linspace(1, 10, 998), [1e-5, 1e5]])
    for kind, many in (("amount", values), ("change", np.concatenate([values, -values]))):
        scale = scale_of(many, kind)  # type: ignore[arg-type]
        assert 9 < scale.ticks[-1] < 10.1
        levels = scale.levels(np.array([9.0, 1e5]))
        assert STEPS - 10 < levels[0] < levels[1] == STEPS
        assert scale.labels()[-1].endswith("and more, to 100,000")
    assert scale_of(values, "amount").labels()[0].endswith("and less, to 1.00e-05")
    few = scale_of(np.array([1.0, 5.0, 1e5]), "amount")
    assert few.ticks[-1] == 1e5
    assert few.labels()[-1] == "100,000"


def test_regions_of_like_size_are_told_apart() -> None:
    counts = np.array([1110, 5452, 1513, 4446, 418, 1440, 809, 2677])
    levels = scale_of(counts, "amount").levels(counts)
    assert (levels.min(), levels.max()) == (1, STEPS)
    assert np.array_equal(np.argsort(levels, kind="stable"), np.argsort(counts, kind="stable"))
