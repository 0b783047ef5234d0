"""Clone and split: who grows, and what children are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.density.growth import growth, shared_opacity, split_children

FLOAT32 = 1e-6  # one rounding of numbers about 1
SAMPLES = 20_000  # relative error of an estimated deviation: 1 / sqrt(2 SAMPLES) = 0.005
ESTIMATE = 0.025  # five of those


def test_who_grows_and_how() -> None:
    gradient = np.array([0.9, 1.0, 1.0, 2.0, 5.0])
    threshold = np.array([1.0, 1.0, 1.0, 3.0, 3.0])
    scales = np.array([[1, 1, 1], [1, 1, 1], [1, 1.5, 1], [9, 9, 9], [0, 0, 9]], float)
    grown = growth(gradient, threshold, scales, 1.0)
    assert grown.clone.tolist() == [False, True, False, False, False]
    assert grown.split.tolist() == [False, False, True, False, True]


@pytest.mark.parametrize("poison", [np.inf, np.nan])
def test_what_has_no_finite_size_does_not_grow(poison: float) -> None:
    scales = np.array([[1, 1, 1], [1, poison, 1], [1, 1.5, 1]])
    grown = growth(np.full(3, 5.0), np.ones(3), scales, 1.0)
    assert grown.clone.tolist() == [True, False, False]
    assert grown.split.tolist() == [False, False, True]


def children(spread: str):
    rng = np.random.default_rng(0)
    position = np.tile(np.float32([0.1, -0.2, 0.3]), (SAMPLES, 1))
    log_scale = np.tile(np.log(np.float32([0.5, 0.1, 0.02])), (SAMPLES, 1))
    half = np.float32(np.sqrt(0.5))
    turned = np.tile(np.float32([half, 0, 0, half]) * 3, (SAMPLES, 1))  # 90 degrees about z, not of unit length
    size = np.full(SAMPLES, 0.004, np.float32)
    return position, log_scale, split_children(position, log_scale, turned, size, rng, spread)


@pytest.mark.parametrize(("spread", "factor"), [("local", 1.0), ("world", 0.004)])
def test_children_spread_around_their_parent_by_its_own_turned_extent(spread, factor) -> None:
    position, _, (means, _) = children(spread)
    offsets = (means - np.tile(position, (2, 1))).astype(np.float64)
    expected = factor * np.array([0.1, 0.5, 0.02])  # x and y change places
    # single precision near 0.3 resolves 3e-8: 0.04 % of the smallest deviation
    assert offsets.std(axis=0) == pytest.approx(expected, rel=ESTIMATE)
    assert np.abs(offsets.mean(axis=0) / expected).max() < 5 / np.sqrt(2 * SAMPLES)


def test_children_are_smaller_by_the_same_factor() -> None:
    _, log_scale, (_, sizes) = children("world")
    assert np.exp(sizes) == pytest.approx(np.tile(np.exp(log_scale), (2, 1)) / (0.8 * 2), rel=5 * FLOAT32)
    assert sizes.dtype == np.float32


def test_no_parents_no_children() -> None:
    none = [np.zeros((0, width), np.float32) for width in (3, 3, 4)]
    means, sizes = split_children(*none, np.zeros(0, np.float32), np.random.default_rng(0))
    assert means.shape == sizes.shape == (0, 3)


@given(st.floats(-80, 30))
def test_a_shared_opacity_lets_through_twice_what_the_whole_let_through_once(logit) -> None:
    """The oracle is the law itself, in float64: (1 - o')^2 = 1 - o, with o' = o / (1 + sqrt(1 - o))."""
    shared = shared_opacity(np.array([logit]))[0]
    opacity = 1 / (1 + np.exp(-logit))
    half = 1 / (1 + np.exp(-shared))
    rest = 1 / (1 + np.exp(logit))  # 1 - o, of which nothing is lost near 1
    assert half == pytest.approx(opacity / (1 + np.sqrt(rest)), rel=1e-12)
    assert (1 / (1 + np.exp(shared))) ** 2 == pytest.approx(rest, rel=1e-10)
    assert shared < logit


def test_shared_opacities_keep_their_type_at_every_extreme() -> None:
    logit = np.array([-1e30, -100, 0, 100, 3e38], np.float32)
    shared = shared_opacity(logit)
    assert shared.dtype == np.float32
    assert np.isfinite(shared).all()
