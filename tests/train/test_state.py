"""Rows come and go with all that belongs to them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState, initial_state, rearrange

N = 12


def marked_state() -> TrainState:
    """Give a state with as many timesteps as Gaussians, where every number of row i is i."""
    state = initial_state(initial_gaussians(N, np.random.default_rng(0), 1), Motion.rest(0, 2, N), 8, 3e-4, 0.2)
    for kind, sign in ((state.values, 1), (state.first, 2), (state.second, 3)):
        for name in (*ATTRIBUTES, *FITTED_MOTION):
            kind[name][:] = sign * np.arange(N).reshape((N, *[1] * (kind[name].ndim - 1)))
    state.gradient_sum[:] = np.arange(N)
    state.gradient_count[:] = np.arange(N)
    return state


@given(st.lists(st.tuples(st.integers(0, N - 1), st.booleans()), max_size=30))
def test_attributes_moments_and_statistics_move_together_and_motion_stays(chosen) -> None:
    state = marked_state()
    rows, fresh = np.array([row for row, _ in chosen], int), np.array([new for _, new in chosen], bool)
    rearrange(state, rows, fresh)
    order = np.argsort(rows, kind="stable")  # row i is on triangle i
    assert np.array_equal(state.binding, rows[order])
    assert np.array_equal(state.gradient_sum, rows[order])
    assert np.array_equal(state.gradient_count, rows[order])
    for name in ATTRIBUTES:
        for kind, sign in ((state.values, 1), (state.first, 2), (state.second, 3)):
            value = kind[name].reshape(len(rows), int(np.prod(kind[name].shape[1:])))
            expected = sign * np.where(fresh[order] & (sign > 1), 0, rows[order])
            assert (value == expected[:, None]).all()
            assert kind[name].flags.c_contiguous
    for name in FITTED_MOTION:
        assert (state.first[name][:, 0] == 2 * np.arange(N)).all()


def test_given_values_go_where_their_rows_go() -> None:
    state = marked_state()
    rows = np.array([5, 1, 1])
    rearrange(state, rows, None, {"opacity_logit": np.array([50, 10, 11], np.float32)})
    assert state.binding.tolist() == [1, 1, 5]
    assert state.values["opacity_logit"].tolist() == [10, 11, 50]
    assert state.values["sensitivity_logit"].tolist() == [1, 1, 5]


def test_an_initial_state_follows_the_method() -> None:
    state = initial_state(initial_gaussians(N, np.random.default_rng(0), 3), Motion.rest(0, 2, 4), 8, 3e-4, 0.2)
    sigmoid = 1 / (1 + np.exp(-state.values["sensitivity_logit"].astype(float)))
    assert np.allclose(sigmoid, 0.1, atol=1e-7)
    assert state.thresholds.tolist() == [3e-4] * 8
    assert state.ratios.tolist() == [0.2] * 8
    assert not any(moment.any() for kind in (state.first, state.second) for moment in kind.values())
