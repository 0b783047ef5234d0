"""Region means and what follows from them, against naive loops and the method's laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.density.modulators import bounded, modulators
from sacha_core.density.region_means import region_means

ROUNDING = 1e-12  # float64 sums of at most a few hundred numbers


@st.composite
def populations(draw):
    n = draw(st.integers(1, 200))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return (
        rng.uniform(0.01, 0.99, n),
        rng.integers(0, draw(st.integers(1, 8)), n),
        rng.random(n) * (rng.random(n) < 0.7),
    )


@given(populations())
def test_means_are_those_of_a_naive_loop(population) -> None:
    sensitivity, regions, weights = population
    for w in (None, weights):
        means = region_means(sensitivity, regions, 8, w)
        for region in range(8):
            members = [i for i in range(len(regions)) if regions[i] == region]
            total = sum(1.0 if w is None else w[i] for i in members)
            assert means.counts[region] == len(members)
            if total == 0:
                assert np.isnan(means.region[region])
            else:
                expected = sum(sensitivity[i] * (1.0 if w is None else w[i]) for i in members) / total
                assert means.region[region] == pytest.approx(expected, rel=ROUNDING)


@given(populations())
def test_modulators_balance(population) -> None:
    """The count-weighted harmonic mean of the modulators is 1: what one region gains others pay."""
    sensitivity, regions, _ = population
    means = region_means(sensitivity, regions, 8)
    assert np.sum(means.counts / modulators(means)) == pytest.approx(len(regions), rel=ROUNDING)


@pytest.mark.parametrize("sensitivity", [0.37, 0.0, 1e-9, 1.0])
@pytest.mark.parametrize("weights", [None, np.random.default_rng(0).random(30)])
def test_equal_sensitivities_modulate_nothing(sensitivity, weights) -> None:
    means = region_means(np.full(30, sensitivity), np.arange(30) % 5, 8, weights)
    assert np.array_equal(modulators(means), np.ones(8))


def test_no_gaussians_and_no_weight_modulate_nothing() -> None:
    nobody = region_means(np.zeros(0), np.zeros(0, int), 8)
    assert np.array_equal(modulators(nobody), np.ones(8))
    unseen = region_means(np.full(4, 0.5), np.zeros(4, int), 8, np.zeros(4))
    assert np.array_equal(modulators(unseen), np.ones(8))


def test_a_vanishing_mean_stays_finite_and_above_0() -> None:
    for sensitivity in ([0.0, 0.5], [0.0, 1e-12], [1e-30, 1.0]):
        modulator = modulators(region_means(np.array(sensitivity), np.array([0, 1]), 2))
        assert np.isfinite(modulator).all()
        assert (modulator > 0).all()


@given(st.lists(st.floats(0.01, 100), min_size=2, max_size=8))
def test_thresholds_and_ratios_follow_the_modulator_and_stop_at_their_bounds(values) -> None:
    modulator = np.sort(values)
    for base, lowest, highest in ((3e-4, 1.5e-4, 6e-4), (0.2, 0.1, 0.4)):
        result = bounded(base, modulator, lowest, highest)
        assert (np.diff(result) >= 0).all()
        assert result[modulator * base <= lowest] == pytest.approx(lowest, rel=0)
        assert result[modulator * base >= highest] == pytest.approx(highest, rel=0)
        inside = (modulator * base > lowest) & (modulator * base < highest)
        assert result[inside] == pytest.approx(base * modulator[inside], rel=ROUNDING)
