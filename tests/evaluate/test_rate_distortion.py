"""Rate-distortion curves. Oracles: closed forms, the package `bjontegaard`, and reading points back."""

from __future__ import annotations

from itertools import pairwise

import bjontegaard
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.evaluate import rate_distortion
from sacha_core.evaluate.rate_distortion import (
    bd_quality,
    bd_rate,
    bytes_at,
    common_quality,
    quality_at,
    rd_curve,
)

ROUNDING = 1e-9  # relative; a few float64 operations on logarithms
LEVELS = ((40e3, 31.0), (70e3, 32.6), (120e3, 33.7), (230e3, 34.2))


def scaled(points, factor):
    return [(size * factor, quality) for size, quality in points]


@pytest.mark.parametrize("factor", [0.55, 0.9, 1.0, 1.8])
def test_a_curve_of_scaled_bytes_has_exactly_that_rate(factor):
    anchor, test = rd_curve(LEVELS), rd_curve(scaled(LEVELS, factor))
    found = bd_rate(anchor, test)
    assert found.value == pytest.approx(100 * (factor - 1), rel=ROUNDING, abs=ROUNDING)
    assert found.overlap == 1
    assert found.reason == ""


def test_a_curve_of_shifted_quality_has_exactly_that_gain():
    anchor = rd_curve(LEVELS)
    found = bd_quality(anchor, rd_curve([(size, quality + 0.7) for size, quality in LEVELS]))
    assert found.value == pytest.approx(0.7, rel=ROUNDING)
    assert found.overlap == 1


def test_straight_lines_in_log_bytes_have_a_closed_form():
    """Lines q = s log10(b) + c with the same slope lie 10^(difference of c / s) apart wherever they overlap, partly or not."""
    slope, sizes = 5.0, np.array([1e4, 2e4, 5e4, 1e5])
    anchor = rd_curve(zip(sizes, slope * np.log10(sizes), strict=True))
    test = rd_curve(zip(2 * sizes, slope * np.log10(2 * sizes) + 1, strict=True))
    assert bd_rate(anchor, test).value == pytest.approx(100 * (10 ** (-1 / slope) - 1), rel=ROUNDING)
    assert bd_quality(anchor, test).value == pytest.approx(1, rel=ROUNDING)
    assert bd_rate(anchor, test).overlap == pytest.approx(
        (slope - slope * np.log10(2) - 1) / (slope + slope * np.log10(2) + 1)
    )


@given(seed=st.integers(0, 10_000), n=st.integers(2, 6), m=st.integers(2, 6))
def test_deltas_are_those_of_the_package(seed, n, m):
    rng = np.random.default_rng(seed)
    curves = []
    for k in (n, m):
        sizes = 1e4 * np.cumprod(1.1 + rng.random(k))
        curves.append((sizes, 30 + np.cumsum(0.2 + 2 * rng.random(k))))
    anchor, test = (rd_curve(zip(*curve, strict=True)) for curve in curves)
    arguments = (*curves[0], *curves[1], "pchip")
    options = {"require_matching_points": False, "min_overlap": 0}
    for ours, theirs, axis in ((bd_rate, bjontegaard.bd_rate, 1), (bd_quality, bjontegaard.bd_psnr, 0)):
        low, high = max(curve[axis][0] for curve in curves), min(curve[axis][-1] for curve in curves)
        found = ours(anchor, test)
        if low >= high:
            assert found.value is None
        else:
            assert found.value == pytest.approx(theirs(*arguments, **options), rel=1e-6, abs=1e-9)


def test_points_are_met_exactly_and_nothing_is_said_beyond_them():
    curve = rd_curve(reversed(LEVELS))
    for size, quality in LEVELS:
        assert bytes_at(curve, quality).value == pytest.approx(size, rel=ROUNDING)
        assert quality_at(curve, size).value == pytest.approx(quality, rel=ROUNDING)
    for found in (bytes_at(curve, 30.9), bytes_at(curve, 34.3), quality_at(curve, 39e3), quality_at(curve, 231e3)):
        assert found.value is None
        assert "outside what was measured" in found.reason


@given(seed=st.integers(0, 10_000))
def test_more_quality_never_takes_fewer_bytes(seed):
    rng = np.random.default_rng(seed)
    curve = rd_curve(zip(1e4 * (1 + 9 * rng.random(5)), 30 + 5 * rng.random(5), strict=True))
    if len(curve.quality) > 1:
        asked = np.linspace(*curve.range, 50)
        sizes = [bytes_at(curve, quality).value for quality in asked]
        assert all(b >= a * (1 - ROUNDING) for a, b in pairwise(sizes))
        assert min(sizes) >= curve.n_bytes[0] * (1 - ROUNDING)


def test_what_is_worse_at_more_bytes_is_dropped_and_listed():
    worse, equal = (100e3, 32.5), (75e3, 32.6)
    curve = rd_curve([worse, *LEVELS, equal])
    assert list(zip(curve.n_bytes, curve.quality, strict=True)) == list(LEVELS)
    assert curve.dropped == (equal, worse)
    assert rd_curve([(1.0, 2.0), (1.0, 3.0)]).quality == (3.0,)  # the better one of two equal sizes


def test_lower_is_better():
    flips = [(40e3, 0.09), (70e3, 0.07), (120e3, 0.06)]
    anchor, test = rd_curve(flips, True), rd_curve(scaled(flips, 0.5), True)
    assert anchor.dropped == ()
    assert bd_rate(anchor, test).value == pytest.approx(-50, rel=ROUNDING)
    assert bytes_at(anchor, 0.07).value == pytest.approx(70e3, rel=ROUNDING)
    better = rd_curve([(size, flip - 0.01) for size, flip in flips], True)
    assert bd_quality(anchor, better).value == pytest.approx(-0.01, rel=ROUNDING)
    assert rd_curve([*flips, (200e3, 0.065)], True).dropped == ((200e3, 0.065),)


def test_without_anything_in_common_there_is_a_reason():
    anchor = rd_curve(LEVELS)
    apart = rd_curve([(size * 10, quality + 10) for size, quality in LEVELS])
    assert bd_rate(anchor, apart).value is None
    assert bd_rate(anchor, apart).reason == "the curves have no quality in common"
    assert bd_quality(anchor, apart).reason == "the curves have no size in common"
    assert common_quality([anchor, apart]) is None
    assert common_quality([anchor, rd_curve(LEVELS[1:])]) == (32.6, 34.2)
    alone = rd_curve(LEVELS[:1])
    for found in (bd_rate(anchor, alone), bd_quality(alone, anchor), bytes_at(alone, 31.0), quality_at(alone, 40e3)):
        assert found.value is None
        assert "two points" in found.reason


def test_without_scipy_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setattr(rate_distortion.importlib.util, "find_spec", lambda _: None)
    curve = rd_curve(LEVELS)
    for found in (bd_rate(curve, curve), bytes_at(curve, 32.0)):
        assert found.value is None
        assert "pip install scipy" in found.reason


@pytest.mark.parametrize("points", [[], [(0.0, 30.0)], [(10.0, float("inf"))], [(float("nan"), 30.0)]])
def test_what_cannot_be_a_point_is_refused(points):
    with pytest.raises(ValueError, match=r"point"):
        rd_curve(points)
