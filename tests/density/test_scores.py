"""Importance scores against naive loops in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.density.scores.perceptual import perceptual_score
from sacha_core.density.scores.removal import removal_score
from sacha_core.density.scores.rounding import rounded
from sacha_core.density.scores.volume import volume_factor

ROUNDING = 1e-12  # float64 products


@pytest.fixture
def population() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    weight = rng.exponential(40, 101) * (rng.random(101) < 0.8)
    return {
        "weight": weight,
        "sensitive_weight": weight * rng.random(101),
        "sensitivity": rng.random(101),
        "scales": np.exp(rng.normal(-1, 1, (101, 3))),
    }


def naive_percentile(values: list[float], percent: float) -> float:
    """Interpolate linearly between the two nearest ranks."""
    ordered = sorted(values)
    place = percent / 100 * (len(ordered) - 1)
    low = math.floor(place)
    return ordered[low] + (place - low) * (ordered[min(low + 1, len(ordered) - 1)] - ordered[low])


def test_perceptual_score_is_that_of_a_naive_loop(population) -> None:
    score = perceptual_score(**population, pixel_factor=0.5, gaussian_factor=2.0)
    volumes = [4 / 3 * math.pi * a * b * c for a, b, c in population["scales"]]
    reference = naive_percentile(volumes, 90)
    for i, volume in enumerate(volumes):
        seen = population["weight"][i] + 0.5 * population["sensitive_weight"][i]
        expected = seen * (1 + 2.0 * population["sensitivity"][i]) * min(volume / reference, 1) ** 0.1
        assert score[i] == pytest.approx(expected, rel=ROUNDING)


def test_light_gaussian_is_the_perceptual_score_without_perception(population) -> None:
    plain = perceptual_score(**population, pixel_factor=0.0, gaussian_factor=0.0)
    assert light_gaussian_score(population["weight"], population["scales"]) == pytest.approx(plain, rel=ROUNDING)


def test_the_released_variant_has_no_bound_and_another_percentile(population) -> None:
    volumes = [a * b * c for a, b, c in population["scales"]]
    reference = naive_percentile(volumes, 10)
    expected = [w * (v / reference) ** 0.1 for w, v in zip(population["weight"], volumes, strict=True)]
    score = light_gaussian_score(population["weight"], population["scales"], "code")
    assert score == pytest.approx(expected, rel=ROUNDING)


def test_what_is_never_seen_scores_exactly_nothing(population) -> None:
    score = perceptual_score(**population)
    assert np.array_equal(score == 0, population["weight"] == 0)


@given(st.floats(1e-3, 1e3))
def test_only_relative_volume_counts(factor) -> None:
    scales = np.exp(np.random.default_rng(1).normal(-1, 1, (50, 3)))
    assert volume_factor(scales * factor) == pytest.approx(volume_factor(scales), rel=1e-10)


def test_volume_of_one_of_none_and_of_points() -> None:
    assert volume_factor(np.array([[0.1, 0.2, 0.3]])).tolist() == [1.0]
    assert volume_factor(np.zeros((0, 3))).shape == (0,)
    assert np.isfinite(volume_factor(np.zeros((5, 3)))).all()


@given(st.lists(st.floats(1e-20, 1e20) | st.just(0.0), max_size=20))
def test_rounding_keeps_six_digits(values) -> None:
    for value, short in zip(values, rounded(np.array(values)), strict=True):
        assert short == pytest.approx(float(f"{value:.5e}"), rel=1e-14, abs=0)


def test_rounding_of_numbers_at_the_edge_of_float64() -> None:
    assert rounded(np.array([0.0, 5e-324, 1e-305, 1.2345678e-299, 1.7e308])).tolist() == pytest.approx(
        [0, 0, 0, 1.23457e-299, 1.7e308], rel=1e-14, abs=0
    )


def test_rounding_ends_noise_between_near_ties() -> None:
    noisy = 123.456 * (1 + np.random.default_rng(2).normal(0, 1e-9, 100))
    assert len(set(rounded(noisy))) == 1


def test_sizes_without_end_or_thickness_have_finite_factors() -> None:
    scales = np.array([[np.inf, 1, 1], [np.inf, 0, 1], [1e200, 1e200, 1], [0.1, 0.2, 0.3], [np.nan, 1, 1]])
    factors = volume_factor(scales)
    assert np.isfinite(factors).all()
    assert factors.argmax() in {0, 2}


def test_removal_score_is_that_of_a_naive_loop() -> None:
    rng = np.random.default_rng(1)
    change = rng.exponential(2, 50) * (rng.random(50) < 0.8)
    sensitive_change, sensitivity = change * rng.random(50), rng.random(50)
    score = removal_score(change, sensitive_change, sensitivity, pixel_factor=0.5, gaussian_factor=2.0)
    expected = [(c + 0.5 * s) * (1 + 2.0 * a) for c, s, a in zip(change, sensitive_change, sensitivity, strict=True)]
    assert score == pytest.approx(expected, rel=ROUNDING)
    assert np.array_equal(score == 0, change == 0)
    assert np.array_equal(removal_score(change, sensitive_change, sensitivity), change)
    assert not len(removal_score(*np.empty((3, 0))))
