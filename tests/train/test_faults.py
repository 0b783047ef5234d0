"""Steps that are not finite: nothing moves, and what was wrong is told."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from sacha_core.bench.stability.poison import spoiled_gradients
from sacha_core.progress import silent
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.faults import CAUSES, LARGEST_GRADIENT, Fault, Faults
from sacha_core.train.gradients import WIDTHS
from sacha_core.train.loop import Run, train
from sacha_core.train.options import LearningRates, TrainOptions
from sacha_core.train.presets import scaled
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

OPTIONS = TrainOptions(threads=2, sh_degree=1, device="cpu")
SPLATS_OF = {
    "position": "means", "log_scale": "scales", "quaternion": "quaternions", "opacity_logit": "opacities", "sh_dc": "colours",
}  # fmt: skip


@pytest.fixture
def run(tiny, tmp_path) -> Run:
    """Give a run whose first iterations are behind it."""
    options = scaled(1000, "default", OPTIONS)
    options = replace(options, schedule=replace(options.schedule, sh_every=1))
    made = Run(tiny.capture, tiny.head, options, tmp_path, silent)
    made.begin(resume=False, start_from=None)
    for _ in range(3):
        made.iterate()
    made.engine.losses()
    return made


def everything(run: Run) -> dict[str, np.ndarray]:
    """Give copies of all that a step changes."""
    state = run.engine.take()
    kinds = {"value": state.values, "first": state.first, "second": state.second}
    arrays = {f"{kind} of {name}": array.copy() for kind, arrays in kinds.items() for name, array in arrays.items()}
    return arrays | {
        "sum": state.gradient_sum.copy(), "count": state.gradient_count.copy(), "steps": np.array(list(state.steps.values())),
    }  # fmt: skip


def changed(run: Run, before: dict[str, np.ndarray]) -> list[str]:
    return [name for name, array in everything(run).items() if not np.array_equal(array, before[name])]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e12 * LARGEST_GRADIENT])
@pytest.mark.parametrize("name", SPLATS_OF)
def test_a_gradient_that_is_not_finite_changes_nothing_and_is_told_with_its_first_row(run, name, value) -> None:
    spoilt_rows = []

    def spoil(frame, slopes):
        rows = np.flatnonzero(frame.visible)
        for row in rows[[40, 7, 30]]:
            getattr(slopes, SPLATS_OF[name]).reshape(len(frame.visible), -1)[row, -1 if name == "quaternion" else 0] = (
                value
            )
        spoilt_rows.append(int(rows[7]))

    before = everything(run)
    with spoiled_gradients(spoil):
        run.iterate()
        run.iterate()
    assert changed(run, before) == []
    faults = run.engine.take().faults
    assert faults.count == 2
    assert faults.first == Fault(4, name, spoilt_rows[0])
    assert run.engine.losses() == {}
    run.iterate()
    assert len(changed(run, before)) > 10
    assert run.engine.take().faults == faults


def test_a_colour_that_is_not_finite_is_a_fault_of_its_gaussian(run) -> None:
    run.engine.take().values["sh_dc"][[9, 5], 1] = 3.4e38
    before = everything(run)
    run.iterate()
    assert changed(run, before) == []
    assert run.engine.take().faults == Faults(1, Fault(4, "colour", 5))


def test_a_pose_that_degenerates_on_the_way_is_a_fault_of_its_timestep(run) -> None:
    state = run.engine.take()
    state.values["expression"][:] = np.nan
    before = everything(run)
    scale = run.engine.triangle_scale.copy()
    run.iterate()
    assert [name for name in changed(run, before) if "expression" not in name] == []
    first = run.engine.take().faults.first
    assert (first.iteration, first.parameter) == (4, "pose")
    assert first.row in {0, 1}
    assert np.array_equal(run.engine.triangle_scale, scale)
    target = run.views[0]
    assert not run.engine.weights([target], 1).any()


def test_a_gaussian_beyond_all_numbers_stops_nobody(run) -> None:
    state = run.engine.take()
    state.values["log_scale"][17] = 100  # its standard deviations are infinite, so it is never drawn
    state.values["position"][3] = 3e38
    before = everything(run)
    run.iterate()
    assert run.engine.take().faults.count == 0
    assert len(changed(run, before)) > 10
    assert all(np.isfinite(state.values[name]).all() for name in (*ATTRIBUTES, *FITTED_MOTION))


def test_density_control_goes_on_where_a_step_was_skipped(tiny, tmp_path, monkeypatch) -> None:
    options = scaled(40, "default", OPTIONS)
    options = replace(options, schedule=replace(options.schedule, densify_every=4, densify_from=3))
    differentiate, bad = CpuEngine.differentiate, (4, 13, 14)

    def poison(frame, slopes):
        slopes.means[np.flatnonzero(frame.visible)[0]] = np.nan

    def spoilt(self, iteration, targets, degree):
        with spoiled_gradients(poison) if iteration in bad else nullcontext():
            differentiate(self, iteration, targets, degree)

    monkeypatch.setattr(CpuEngine, "differentiate", spoilt)
    model = train(tiny.capture, tiny.head, options, tmp_path)
    assert model.faults.count == len(bad)
    assert model.faults.first.iteration == bad[0]
    model.gaussians.validate(tiny.head.n_faces)
    assert {event.iteration for event in model.events} >= {4, 8, 12}


def test_values_stay_finite_when_rates_are_a_hundred_times_too_high(tiny, tmp_path) -> None:
    rates = LearningRates()
    high = {name: 100 * value for name, value in vars(rates).items()}
    options = replace(scaled(60, "default", OPTIONS), rates=LearningRates(**high))
    model = train(tiny.capture, tiny.head, options, tmp_path)
    model.gaussians.validate(tiny.head.n_faces)
    model.motion.validate()


def test_causes_are_all_attributes_and_in_the_order_in_which_the_cpu_looks() -> None:
    assert sorted(CAUSES) == sorted(ATTRIBUTES)
    assert [name for name in CAUSES if name != "sh_rest"] == list(WIDTHS)


def test_a_fault_says_what_was_wrong_in_a_sentence() -> None:
    assert str(Faults()) == "no step was skipped"
    one = Faults().and_one(Fault(7, "position", 31))
    assert (
        str(one)
        == "1 step was skipped, at iteration 7: gradient of position of Gaussian 31 was not finite, or too large for float32"
    )
    two = one.and_one(Fault(9, "loss", 2))
    assert (
        str(two)
        == "2 steps were skipped, the first at iteration 7: gradient of position of Gaussian 31 was not finite, or too large for float32"
    )
    assert str(Fault(1, "jaw", 4)) == "gradient of jaw of timestep 4 was not finite, or too large for float32"
    assert str(Fault(1, "pose", 4)) == "the pose of timestep 4 left a triangle without area"
    assert str(Fault(1, "loss", 4)) == "loss of a view of timestep 4 was not finite"
    assert str(Fault(1, "colour", 4)) == "colour of Gaussian 4 was not finite, or too large for float32"
