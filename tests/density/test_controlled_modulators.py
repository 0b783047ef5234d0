"""Laws of the experiments' controls: what becomes of the modulators learnt."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.density.modulators import controlled

ROUNDING = 1e-15  # of two divisions in float64
learned = st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=8).map(np.array)


@given(learned, st.integers(0, 2**32))
def test_the_learned_ones_stay_as_they_are(modulator, seed) -> None:
    assert np.array_equal(controlled(modulator, "learned", seed), modulator)


@given(learned)
def test_inverting_twice_changes_nothing_and_once_turns_the_order_round(modulator) -> None:
    inverted = controlled(modulator, "inverted", 0)
    assert controlled(inverted, "inverted", 0) == pytest.approx(modulator, rel=ROUNDING)
    assert (np.diff(inverted[np.argsort(modulator)]) <= 0).all()


@given(learned, st.integers(0, 2**32))
def test_random_ones_are_the_same_numbers_and_go_by_the_seed_alone(modulator, seed) -> None:
    drawn = controlled(modulator, "random", seed)
    assert np.array_equal(np.sort(drawn), np.sort(modulator))
    order = controlled(np.arange(len(modulator), dtype=float), "random", seed).astype(int)
    assert np.array_equal(drawn, modulator[order])  # later calibrations permute alike


def test_seeds_draw_different_regions() -> None:
    drawn = {tuple(controlled(np.arange(8.0), "random", seed)) for seed in range(20)}
    assert len(drawn) == 20


@given(learned, st.integers(0, 2**32))
def test_uniform_ones_are_1(modulator, seed) -> None:
    assert np.array_equal(controlled(modulator, "uniform", seed), np.ones(len(modulator)))


@pytest.mark.parametrize("mode", ["learned", "inverted", "random", "uniform"])
def test_regions_alike_stay_alike_in_every_control(mode) -> None:
    assert np.array_equal(controlled(np.ones(8), mode, 3), np.ones(8))
