"""Adam against torch's."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.stability.exact_step import harmonics
from sacha_core.parallel.pool import Pool
from sacha_core.train.gradients import ViewColours
from sacha_core.train.optimiser import BETAS, EPSILON, Adam, MotionSlopes, Slopes
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState, initial_state

STEPS = 12
FLOAT32 = 2e-6  # relative, of steps of 0.01 that add up to about 1 through float32 rounding in another order
N = 1500 - 3  # no whole number of vectors
PLAIN = tuple(name for name in ATTRIBUTES if name != "sh_rest")


def fresh() -> TrainState:
    gaussians = initial_gaussians(N, np.random.default_rng(0), 3)
    return initial_state(gaussians, Motion.rest(0, 4, 5), 8, 3e-4, 0.2)


def gradients(state: TrainState, step: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(step)
    made = {name: rng.normal(0, 10.0 ** rng.integers(-6, 2), state.values[name].shape) for name in PLAIN}
    made["position"][::3] = 0  # never seen
    return {name: value.astype(np.float32) for name, value in made.items()}


def views(step: int, count: int) -> tuple[np.ndarray, list[ViewColours]]:
    """Give places in the world, and what some cameras say of the colours there."""
    rng = np.random.default_rng(step)
    means = rng.normal(size=(N, 3)).astype(np.float32)
    cuts = rng.normal(size=(count, N, 3)).astype(np.float32)
    cuts[:, : N // 2 : 2] = 0
    return means, [ViewColours(rng.normal(0, 5, 3).astype(np.float32), cut) for cut in cuts]


def by_rest(means: np.ndarray, colours: list[ViewColours], degree: int) -> np.ndarray:
    """Give the gradient by sh_rest as a sum over views, in float64."""
    total = np.zeros((N, 15, 3))
    for view in colours:
        towards = torch.from_numpy(means.astype(float) - view.centre)
        basis = harmonics(towards / towards.norm(dim=1, keepdim=True), degree).numpy()[:, 1:]
        total[:, : basis.shape[1]] += basis[:, :, None] * view.cut[:, None]
    return total


@pytest.mark.parametrize(("degree", "cameras"), [(0, 1), (1, 1), (2, 3), (3, 1), (3, 2)])
def test_steps_are_those_of_torch(degree: int, cameras: int) -> None:
    state = fresh()
    names = PLAIN if degree == 0 else ATTRIBUTES
    tensors = {name: torch.tensor(state.values[name], requires_grad=True) for name in names}
    rates = {name: 0.01 * (i + 1) for i, name in enumerate(ATTRIBUTES)}
    groups = [{"params": [tensors[name]], "lr": rates[name]} for name in names]
    reference = torch.optim.Adam(groups, betas=BETAS, eps=EPSILON)
    for step in range(STEPS):
        made, (means, colours) = gradients(state, step), views(step, cameras)
        for name in PLAIN:
            tensors[name].grad = torch.tensor(made[name])
        if degree > 0:
            tensors["sh_rest"].grad = torch.tensor(by_rest(means, colours, degree).astype(np.float32))
        reference.step()
        Adam(Pool(2)).step(state, rates, Slopes(made, means, colours, degree))
    for name in names:
        assert state.values[name] == pytest.approx(tensors[name].detach().numpy(), abs=FLOAT32 * STEPS * rates[name]), (
            name
        )
    assert not state.values["sh_rest"][:, (degree + 1) ** 2 - 1 :].any()
    assert state.steps == {"gaussians": STEPS, "motion": 0}


def test_motion_steps_are_those_of_torch() -> None:
    state = fresh()
    tensors = {name: torch.tensor(state.values[name], requires_grad=True) for name in FITTED_MOTION}
    rates = {name: 0.01 * (i + 1) for i, name in enumerate(FITTED_MOTION)}
    reference = torch.optim.Adam(
        [{"params": [tensors[name]], "lr": rates[name]} for name in FITTED_MOTION], betas=BETAS, eps=EPSILON
    )
    rng = np.random.default_rng(0)
    for step in range(STEPS):
        timestep = step % 3  # two are never seen
        rows = {name: rng.normal(size=state.values[name].shape[1]).astype(np.float32) for name in FITTED_MOTION}
        for name, row in rows.items():
            tensors[name].grad = torch.zeros_like(tensors[name])
            tensors[name].grad[timestep] = torch.tensor(row)
        reference.step()
        Adam(Pool(1)).step(state, rates, None, MotionSlopes(timestep, rows))
    for name in FITTED_MOTION:
        assert state.values[name] == pytest.approx(tensors[name].detach().numpy(), abs=FLOAT32 * STEPS * rates[name]), (
            name
        )
        assert not state.values[name][3:].any()
    assert state.steps == {"gaussians": 0, "motion": STEPS}


def test_threads_change_no_bit() -> None:
    results = []
    for threads in (1, 3):
        state = fresh()
        for step in range(2):
            means, colours = views(step, 2)
            rates = dict.fromkeys(ATTRIBUTES, 0.01)
            Adam(Pool(threads)).step(state, rates, Slopes(gradients(state, step), means, colours, 3))
        results.append(state.values)
    for name in ATTRIBUTES:
        assert np.array_equal(results[0][name], results[1][name]), name


def test_without_gradient_nothing_moves_from_rest_and_no_moment_is_denormal() -> None:
    state, name = fresh(), "opacity_logit"
    before = state.values[name].copy()
    means = np.zeros((N, 3), np.float32)

    def step(slope: float) -> None:
        Adam(Pool(1)).step(state, {name: 0.1}, Slopes({name: np.full_like(before, slope)}, means))

    step(0)
    assert np.array_equal(state.values[name], before)
    step(1e-19)
    for _ in range(1200):  # 0.9 ** 1200 is 1e-55
        step(0)
    assert not state.first[name].any()
    assert np.isfinite(state.values[name]).all()
