"""Fitted exponents against power laws made for it, and against SciPy's regression."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import linregress

from sacha_core.bench.growth import fit_growth, growth_rows

SIZES = [1000, 10_000, 100_000, 1_000_000]
EXACT = 1e-9  # rounding of a few logarithms


@given(st.floats(0.1, 3.0), st.floats(1e-6, 1e3))
def test_a_power_law_is_found_again(exponent: float, factor: float) -> None:
    growth = fit_growth(SIZES, [factor * size**exponent for size in SIZES])
    assert growth.exponent == pytest.approx(exponent, abs=EXACT)
    assert growth.factor == pytest.approx(factor, rel=1e-6)
    assert growth.standard_error < 1e-6


def test_exponent_and_standard_error_are_those_of_linear_regression() -> None:
    rng = np.random.default_rng(0)
    sizes = [1, 3, 10, 30, 100, 300]
    costs = [size**0.8 * math.exp(rng.normal(0, 0.2)) for size in sizes]
    growth, expected = fit_growth(sizes, costs), linregress(np.log(sizes), np.log(costs))
    assert growth.exponent == pytest.approx(expected.slope)
    assert growth.standard_error == pytest.approx(expected.stderr)


def test_two_points_leave_no_standard_error() -> None:
    growth = fit_growth([1, 10], [2.0, 20.0])
    assert growth.exponent == pytest.approx(1)
    assert math.isnan(growth.standard_error)
    assert str(growth) == "1.00"


@pytest.mark.parametrize(
    ("sizes", "costs"), [([5, 5], [1.0, 2.0]), ([1], [1.0]), ([0, 1], [1.0, 1.0]), ([1, 2], [0.0, 1.0])]
)
def test_what_is_no_power_law_is_refused(sizes: list[float], costs: list[float]) -> None:
    with pytest.raises(ValueError, match="power law"):
        fit_growth(sizes, costs)


def test_taking_off_the_smallest_leaves_what_growth_costs() -> None:
    """A constant beside work in proportion hides the exponent of 1 from all fits but the third, for which it is a theorem."""
    rows = growth_rows("work", "frames", SIZES, [500 + 0.001 * size for size in SIZES])
    exponents = {row["fitted"]: row["exponent"] for row in rows}
    assert exponents["all"] < 0.3
    assert exponents["the largest"] < 0.5
    assert exponents["the largest, less the smallest"] == pytest.approx(1, abs=EXACT)


def test_noise_larger_than_growth_is_not_fitted() -> None:
    rows = growth_rows("work", "frames", [1, 2, 4], [5.0, 4.9, 5.1])
    assert [row["fitted"] for row in rows] == ["all", "the largest"]
