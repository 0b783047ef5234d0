"""Adam on a device, and the buffer that it steps: against the formula in float64, and bit for bit where nothing may change."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from cuda_scenes import CPU
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.train.cuda.adam import DeviceAdam
from sacha_core.train.cuda.layout import GROUPS, NAMES, Layout
from sacha_core.train.optimiser import BETAS, EPSILON

SINGLE = 2e-6  # relative: a handful of float32 roundings
N, T = 7, 3
SHAPES = {
    "position": (N, 3), "log_scale": (N, 3), "quaternion": (N, 4), "opacity_logit": (N,), "sensitivity_logit": (N,), "sh_dc": (N, 3),
    "sh_rest": (N, 15, 3), "rotation": (T, 3), "neck": (T, 3), "jaw": (T, 3), "eyes": (T, 6), "translation": (T, 3), "expression": (T, 20),
}  # fmt: skip
LAYOUT = Layout(
    tuple(SHAPES[name] for name in GROUPS["gaussians"]), T, tuple(SHAPES[name][1] for name in GROUPS["motion"])
)
ALL = frozenset({*GROUPS["gaussians"], "motion"})
RATES = {name: 10.0**-place for place, name in enumerate(NAMES, 1)}


def arrays(seed: int, spread: float = 1.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {name: rng.normal(0, spread, shape).astype(np.float32) for name, shape in SHAPES.items()}


def rates() -> torch.Tensor:
    return torch.tensor([RATES[name] for name in NAMES], dtype=torch.float64)


def flat(seed: int) -> torch.Tensor:
    return torch.from_numpy(LAYOUT.pack(arrays(seed)))


def test_a_buffer_gives_back_what_was_put_into_it() -> None:
    given_, back = arrays(0), arrays(1)
    packed = LAYOUT.pack(given_)
    LAYOUT.unpack(packed, back)
    assert all(np.array_equal(back[name], given_[name]) for name in NAMES)
    assert len(packed) == LAYOUT.size
    assert np.count_nonzero(packed) == sum(np.count_nonzero(array) for array in given_.values())


def test_each_number_has_the_owner_whose_view_it_lies_in() -> None:
    owner = LAYOUT.owner(CPU)
    for place, view in enumerate(LAYOUT.views(owner).values()):
        assert (view == place).all()


@given(st.sets(st.sampled_from(sorted(ALL))))
def test_stretches_cover_exactly_what_moves(moving) -> None:
    counts = torch.zeros(LAYOUT.size)
    for begin, end in LAYOUT.runs(frozenset(moving)):
        counts[begin:end] += 1
    for name, view in LAYOUT.views(counts).items():
        assert (view == (("motion" if name in GROUPS["motion"] else name) in moving)).all(), name


def test_all_of_it_is_one_stretch() -> None:
    assert list(LAYOUT.runs(ALL)) == [(0, LAYOUT.size)]


def test_the_table_has_the_motion_side_by_side() -> None:
    flat_ = flat(0)
    views = LAYOUT.views(flat_)
    assert torch.equal(LAYOUT.table(flat_), torch.cat([views[name] for name in GROUPS["motion"]], 1))


def test_steps_are_those_of_the_formula() -> None:
    adam, values = DeviceAdam(LAYOUT, CPU), flat(0)
    expected = {name: value.astype(np.float64) for name, value in arrays(0).items()}
    first, second = ({name: np.zeros(shape) for name, shape in SHAPES.items()} for _ in range(2))
    for step in range(1, 30):
        slopes = arrays(step, 10.0 ** (step % 5 - 4))
        adam.step(values, torch.from_numpy(LAYOUT.pack(slopes)), rates(), torch.tensor(True), ALL)
        for name, slope in slopes.items():
            first[name] = BETAS[0] * first[name] + (1 - BETAS[0]) * slope
            second[name] = BETAS[1] * second[name] + (1 - BETAS[1]) * slope.astype(np.float64) ** 2
            mean, square = first[name] / (1 - BETAS[0] ** step), second[name] / (1 - BETAS[1] ** step)
            expected[name] -= RATES[name] * mean / (np.sqrt(square) + EPSILON)
    assert adam.steps == {"gaussians": 29, "motion": 29}
    for name, view in LAYOUT.views(values).items():
        moved = np.abs(expected[name] - arrays(0)[name]).max()
        assert np.abs(view.numpy() - expected[name]).max() <= SINGLE * max(moved, np.abs(expected[name]).max()), name
    for name, view in LAYOUT.views(adam.second).items():
        assert view.numpy() == pytest.approx(second[name], rel=1e-4), name


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e30])
def test_a_step_that_is_not_sound_changes_no_bit(poison) -> None:
    adam, values = DeviceAdam(LAYOUT, CPU), flat(0)
    for steps in range(2):  # from no moments, and from some
        before = [tensor.clone() for tensor in (values, adam.first, adam.second)]
        adam.step(values, torch.full_like(values, poison), rates(), torch.tensor(False), ALL)
        for tensor, kept in zip((values, adam.first, adam.second), before, strict=True):
            assert torch.equal(tensor, kept)
        assert adam.steps == {"gaussians": steps, "motion": steps}
        adam.step(values, flat(1), rates(), torch.tensor(True), ALL)


def test_what_stays_still_keeps_its_moments_and_its_group_counts_where_another_moves() -> None:
    adam, values = DeviceAdam(LAYOUT, CPU), flat(0)
    adam.step(values, flat(1), rates(), torch.tensor(True), ALL)
    before = {name: view.clone() for name, view in LAYOUT.views(adam.first).items()}
    kept = {name: view.clone() for name, view in LAYOUT.views(values).items()}
    adam.step(values, flat(2), rates(), torch.tensor(True), ALL - {"opacity_logit", "motion"})
    assert adam.steps == {"gaussians": 2, "motion": 1}
    for name in NAMES:
        stays = name == "opacity_logit" or name in GROUPS["motion"]
        assert torch.equal(LAYOUT.views(adam.first)[name], before[name]) == stays, name
        assert torch.equal(LAYOUT.views(values)[name], kept[name]) == stays, name


def test_moments_too_small_for_a_normal_number_become_zero() -> None:
    adam, values = DeviceAdam(LAYOUT, CPU), torch.zeros(LAYOUT.size)
    adam.first.fill_(-1e-37)
    adam.second.fill_(1e-37)
    adam.step(values, torch.zeros_like(values), rates(), torch.tensor(True), ALL)
    assert not adam.first.any()
    assert not adam.second.any()
    assert not values.any()
