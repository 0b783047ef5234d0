"""Adam against torch's, and the learning-rate curve against its formula."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.raster.pool import Pool
from sacha_core.train.optimiser import BETAS, EPSILON, RANGE, adam, position_rate
from sacha_core.train.state import ATTRIBUTES, TrainState, initial_state

STEPS = 12
FLOAT32 = 2e-6  # relative, of steps of 0.01 that add up to about 1 through float32 rounding in another order


@pytest.fixture
def state() -> TrainState:
    gaussians = initial_gaussians(1500, np.random.default_rng(0), 3)
    return initial_state(gaussians, Motion.rest(0, 4, 5), 8, 3e-4, 0.2)


def gradients(state: TrainState, step: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(step)
    made = {name: rng.normal(0, 10.0 ** rng.integers(-6, 2), state.values[name].shape) for name in ATTRIBUTES}
    made["position"][::3] = 0  # never seen
    return {name: value.astype(np.float32) for name, value in made.items()}


def test_steps_are_those_of_torch(state: TrainState) -> None:
    assert state.values["sh_rest"].size > RANGE  # more than one range
    tensors = {name: torch.tensor(state.values[name], requires_grad=True) for name in ATTRIBUTES}
    rates = {name: 0.01 * (i + 1) for i, name in enumerate(ATTRIBUTES)}
    groups = [{"params": [tensors[name]], "lr": rates[name]} for name in ATTRIBUTES]
    reference = torch.optim.Adam(groups, betas=BETAS, eps=EPSILON)
    for step in range(STEPS):
        made = gradients(state, step)
        for name in ATTRIBUTES:
            tensors[name].grad = torch.tensor(made[name])
        reference.step()
        adam(state, "gaussians", made, rates, Pool(2))
    for name in ATTRIBUTES:
        assert state.values[name] == pytest.approx(tensors[name].detach().numpy(), abs=FLOAT32 * STEPS * rates[name])
    assert state.steps == {"gaussians": STEPS, "motion": 0}


def test_threads_change_no_bit(state: TrainState) -> None:
    made = gradients(state, 0)
    results = []
    for threads in (1, 3):
        copy = initial_state(state.gaussians(), Motion.rest(0, 4, 5), 8, 3e-4, 0.2)
        adam(copy, "gaussians", made, dict.fromkeys(ATTRIBUTES, 0.01), Pool(threads))
        results.append(copy.values)
    for name in ATTRIBUTES:
        assert np.array_equal(results[0][name], results[1][name])


def test_without_gradient_nothing_moves_from_rest_and_no_moment_is_denormal(state: TrainState) -> None:
    name = "opacity_logit"
    before = state.values[name].copy()
    adam(state, "gaussians", {name: np.zeros_like(before)}, {name: 0.1}, Pool(1))
    assert np.array_equal(state.values[name], before)
    adam(state, "gaussians", {name: np.full_like(before, 1e-19)}, {name: 0.1}, Pool(1))
    for _ in range(1200):  # 0.9 ** 1200 is 1e-55
        adam(state, "gaussians", {name: np.zeros_like(before)}, {name: 0.1}, Pool(1))
    assert not state.first[name].any()
    assert np.isfinite(state.values[name]).all()


def test_the_position_rate_falls_log_linearly_and_stays() -> None:
    assert position_rate(5e-3, 5e-5, 0, 1000) == pytest.approx(5e-3, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 500, 1000) == pytest.approx(5e-4, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 1000, 1000) == pytest.approx(5e-5, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 9999, 1000) == pytest.approx(5e-5, rel=1e-12)
