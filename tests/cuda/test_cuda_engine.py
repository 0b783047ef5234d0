"""The CUDA engine, on the CPU and with a stand-in for gsplat, against the CPU's engine."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from cuda_scenes import DEGREE

from sacha_core.stopwatch import Stopwatch
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.faults import Fault, Faults
from sacha_core.train.options import DensityOptions, TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState

# Both are float32, in other orders and with other formulas for the exponential; relative to the largest of an array
GRADIENTS = 5e-5
COSINE = 1e-8  # short of 1
LOSSES = 2e-6
LENGTHS = 5e-5
WEIGHTS = 1e-5
# After twenty steps: Adam's steps keep their length however small a gradient is, so that what both engines compute as nothing but rounding
# may go apart by a step each time. So few numbers may differ by more than a hundredth of the way gone
APART, SHARE = 1e-2, 5e-3
RATES = {
    "position": 5e-3, "log_scale": 1.7e-2, "quaternion": 1e-3, "opacity_logit": 5e-2, "sensitivity_logit": 1e-3, "sh_dc": 2.5e-3,
    "sh_rest": 1.25e-4, "rotation": 1e-4, "neck": 1e-4, "jaw": 1e-4, "eyes": 1e-4, "translation": 1e-5, "expression": 1e-3,
}  # fmt: skip
NOTHING: frozenset[str] = frozenset()
FIRST = (0,)
SETS = {"one": (0,), "three": (0, 1, 2), "two sizes": (0, 3, 1)}


@pytest.fixture
def engines(stage):
    """Give a function that makes both engines: the CUDA engine on the CPU, and the CPU's."""

    def made(**options):
        return stage.engine(**options), CpuEngine(stage.head, stage.motion, TrainOptions(threads=1, **options))

    return made


def chosen(stage, places=FIRST):
    return [stage.targets[place] for place in places]


def same(found: np.ndarray, expected: np.ndarray, limit: float) -> bool:
    return bool(np.abs(found - expected).max() <= limit * np.abs(expected).max())


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    a, b = one.ravel().astype(float), other.ravel().astype(float)
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


@pytest.mark.parametrize("degree", [0, 1, DEGREE])
@pytest.mark.parametrize("views", SETS)
def test_a_step_finds_what_the_cpu_finds(stage, state, engines, views, degree) -> None:
    targets, results = chosen(stage, SETS[views]), []
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, targets, degree)
        results.append((engine.losses(), engine.gradients(), engine.take(), engine.triangle_scale))
    (losses, gradients, taken, scale), (losses_, gradients_, taken_, scale_) = results
    assert losses == pytest.approx(losses_, rel=LOSSES)
    assert (
        gradients.keys() == gradients_.keys() == {*ATTRIBUTES, *FITTED_MOTION} - ({"sh_rest"} if degree == 0 else set())
    )
    for name, expected in gradients_.items():
        assert gradients[name].shape == expected.shape, name
        assert expected.any(), name
        assert same(gradients[name], expected, GRADIENTS), name
        assert cosine(gradients[name], expected) > 1 - COSINE, name
        assert np.array_equal(gradients[name] == 0, expected == 0), name
    added, added_ = taken.gradient_sum - state.gradient_sum, taken_.gradient_sum - state.gradient_sum
    assert same(added, added_, LENGTHS)
    assert np.array_equal(taken.gradient_count, taken_.gradient_count)
    assert same(scale, scale_, LOSSES)
    assert taken.faults == taken_.faults == Faults()


def trained(engine, state: TrainState, targets, degree: int, first: int = 1, last: int = 20) -> TrainState:
    engine.put(copy.deepcopy(state))
    for iteration in range(first, last + 1):
        engine.differentiate(iteration, [targets[iteration % len(targets)]], degree)
        engine.advance(RATES, NOTHING)
    return engine.take()


def test_twenty_steps_go_where_the_cpu_goes(stage, state, engines) -> None:
    one, other = (trained(engine, state, stage.targets, DEGREE) for engine in engines())
    assert one.steps == other.steps == {"gaussians": 40, "motion": 50}
    for name, start in state.values.items():
        gone = np.abs(other.values[name] - start).max()
        assert gone > 0, name
        differ = np.abs(one.values[name] - other.values[name]) > APART * gone
        assert differ.mean() <= SHARE, (name, differ.mean())
    for moments in ("first", "second"):
        for name, expected in getattr(other, moments).items():
            assert cosine(getattr(one, moments)[name], expected) > 0.9999, (moments, name)
    assert np.array_equal(one.gradient_count, other.gradient_count)
    assert cosine(one.gradient_sum, other.gradient_sum) > 0.999999


def test_the_same_twice_gives_the_same_bits(stage, state) -> None:
    one, other = (trained(stage.engine(), state, stage.targets, DEGREE, last=3) for _ in range(2))
    for name in state.values:
        assert np.array_equal(one.values[name], other.values[name]), name


def test_weights_are_those_of_the_cpu_and_leave_the_gradients(stage, state, engines) -> None:
    targets, found = chosen(stage, SETS["two sizes"]), []
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage, (4,)), DEGREE)
        before = engine.gradients()
        found.append(engine.weights(targets, DEGREE))
        after = engine.gradients()
        assert all(np.array_equal(after[name], gradient) for name, gradient in before.items())
    assert found[0].dtype == np.float64
    assert same(found[0], found[1], WEIGHTS)
    assert (found[0][:, 1] <= found[0][:, 0]).all()


def test_removals_are_those_of_the_cpu_and_leave_the_gradients(stage, state, engines) -> None:
    targets, found = chosen(stage, SETS["two sizes"]), []
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage, (4,)), DEGREE)
        before = engine.gradients()
        found.append(engine.removals(targets, DEGREE))
        after = engine.gradients()
        assert all(np.array_equal(after[name], gradient) for name, gradient in before.items())
    assert found[0].any(axis=0).all()
    assert np.array_equal(found[0], found[1])  # the CPU draws for both


def test_losses_are_means_since_the_last_call(stage, state) -> None:
    engine = stage.engine()
    engine.put(copy.deepcopy(state))
    assert engine.losses() == {}
    alone = []
    for targets in (chosen(stage), chosen(stage, (1,))):
        engine.differentiate(1, targets, 0)
        alone.append(engine.losses())
    for iteration, targets in enumerate((chosen(stage), chosen(stage, (1,))), 1):
        engine.differentiate(iteration, targets, 0)
    both = engine.losses()
    assert both == pytest.approx({name: (alone[0][name] + alone[1][name]) / 2 for name in both})
    assert engine.losses() == {}


def test_attributes_that_are_void_wait_and_the_others_go_on(stage, state, engines) -> None:
    """As after a reset of opacities: the state is taken, changed and put back between the two halves of an iteration."""
    results = []
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage), DEGREE)
        kept = engine.gradients()
        taken = engine.take()
        taken.values["opacity_logit"][:] = -2
        taken.first["opacity_logit"][:] = taken.second["opacity_logit"][:] = 0
        engine.put(taken)
        again = engine.gradients()
        assert all(np.array_equal(again[name], gradient) for name, gradient in kept.items())
        engine.advance(RATES, frozenset({"opacity_logit"}))
        results.append(engine.take())
    for one in results:
        assert (one.values["opacity_logit"] == -2).all()
        assert not one.first["opacity_logit"].any()
        assert one.steps == {"gaussians": 21, "motion": 31}
    for name, expected in results[1].values.items():
        assert same(results[0].values[name], expected, LOSSES), name


def test_gaussians_may_come_and_go_between_the_halves_of_an_iteration(stage, state, engines) -> None:
    """As after densification: of the gradients kept only those of the motion are good."""
    ends = []
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage), DEGREE)
        taken = engine.take()
        rows = np.arange(len(taken) - 5)
        for arrays in (taken.values, taken.first, taken.second):
            arrays |= {name: arrays[name][rows].copy() for name in ATTRIBUTES}
        taken.binding, taken.gradient_sum, taken.gradient_count = (
            array[rows].copy() for array in (taken.binding, taken.gradient_sum, taken.gradient_count)
        )
        before = copy.deepcopy(taken)
        engine.put(taken)
        engine.advance(RATES, frozenset(ATTRIBUTES))
        after = copy.deepcopy(engine.take())
        assert after.steps == {"gaussians": 20, "motion": 31}
        for name in ATTRIBUTES:
            assert np.array_equal(after.values[name], before.values[name]), name
        engine.differentiate(2, chosen(stage), DEGREE)
        engine.advance(RATES, NOTHING)
        assert engine.take().steps == {"gaussians": 21, "motion": 32}
        ends.append(after)
    for name in FITTED_MOTION:
        assert same(ends[0].first[name], ends[1].first[name], GRADIENTS), name
        assert same(ends[0].values[name], ends[1].values[name], LOSSES), name


SPOILT = {
    "sh_dc": ("sh_dc", (7, 1), np.nan, Fault(5, "colour", 7)),
    "bright": ("sh_dc", (7, 1), 1e31, Fault(5, "colour", 7)),
    "sensitivity": ("sensitivity_logit", (9,), np.nan, Fault(5, "colour", 9)),
    "translation": ("translation", (1, 0), np.nan, Fault(5, "pose", 1)),
    "collapsed": ("translation", 1, 3e38, Fault(5, "pose", 1)),
}


@pytest.mark.parametrize("case", SPOILT)
@pytest.mark.parametrize("which", [0, 1])
def test_a_fault_is_named_and_changes_nothing(stage, state, engines, case, which) -> None:
    name, place, value, fault = SPOILT[case]
    state.values[name][place] = value
    engine = engines()[which]
    engine.put(copy.deepcopy(state))
    engine.differentiate(5, chosen(stage), DEGREE)
    engine.advance(RATES, NOTHING)
    taken = engine.take()
    assert taken.faults == Faults(1, fault)
    assert taken.steps == state.steps
    for kind in ("values", "first", "second"):
        for array, expected in zip(getattr(taken, kind).values(), getattr(state, kind).values(), strict=True):
            assert np.array_equal(array, expected, equal_nan=True)
    assert np.array_equal(taken.gradient_sum, state.gradient_sum)
    assert np.array_equal(taken.gradient_count, state.gradient_count)
    assert engine.losses() == {}


def test_a_pose_without_area_leaves_scales_and_shows_nothing(stage, state, monkeypatch) -> None:
    """Only one triangle may have lost its area, and all else look as ever."""
    engine = stage.engine()
    engine.put(copy.deepcopy(state))
    engine.differentiate(1, chosen(stage), DEGREE)
    before, place = engine.triangle_scale, engine._scene.place
    assert engine.weights(chosen(stage), DEGREE).any()
    monkeypatch.setattr(engine._scene, "place", lambda *given: (*place(*given)[:2], torch.tensor(False)))
    engine.differentiate(2, chosen(stage, (4,)), DEGREE)
    assert np.array_equal(engine.triangle_scale, before)
    assert engine.take().faults == Faults(1, Fault(2, "pose", 2))
    assert not engine.weights(chosen(stage), DEGREE).any()


def test_after_a_fault_training_goes_on(stage, state) -> None:
    """One timestep is spoilt; those of the other are learnt from, and the faults add up over `take` and `put`."""
    state.values["neck"][1, 2] = np.inf
    engine = stage.engine()
    engine.put(copy.deepcopy(state))
    for iteration, place in enumerate((4, 0, 1, 5), 1):
        engine.differentiate(iteration, chosen(stage, (place,)), DEGREE)
        engine.advance(RATES, NOTHING)
        if iteration == 2:
            engine.put(engine.take())
    taken = engine.take()
    assert taken.faults == Faults(2, Fault(2, "pose", 1))
    assert taken.steps == {"gaussians": 22, "motion": 32}
    assert set(engine.losses()) == {"total", "l1", "ssim", "sensitivity", "position", "scale"}
    assert not engine.weights(chosen(stage), DEGREE).any()
    assert np.isfinite(engine.triangle_scale).all()
    assert engine.triangle_scale.any()


@pytest.mark.parametrize(
    ("name", "value"), [("log_scale", 80.0), ("log_scale", -80.0), ("opacity_logit", 100.0), ("opacity_logit", -100.0)]
)
def test_extreme_gaussians_are_no_fault(stage, state, engines, name, value) -> None:
    state.values[name][::9] = value
    for engine in engines():
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage), DEGREE)
        engine.advance(RATES, NOTHING)
        taken = engine.take()
        assert taken.faults == Faults()
        assert all(np.isfinite(array).all() for array in taken.values.values())


def test_motion_that_is_not_fitted_stays(stage, state, engines) -> None:
    for engine in engines(fine_tune=False):
        taken = trained(engine, state, stage.targets, DEGREE, last=2)
        assert engine.gradients().keys() == set(ATTRIBUTES)
        assert all(np.array_equal(taken.values[name], state.values[name]) for name in FITTED_MOTION)
        assert taken.steps == {"gaussians": 22, "motion": 30}


def test_harmonics_that_are_not_in_use_stay(stage, state) -> None:
    taken = trained(stage.engine(), state, stage.targets, 0, last=2)
    for kind in ("values", "first", "second"):
        assert np.array_equal(getattr(taken, kind)["sh_rest"], getattr(state, kind)["sh_rest"])
    assert not np.array_equal(taken.values["sh_dc"], state.values["sh_dc"])


@pytest.mark.parametrize("views", SETS)
def test_absolute_statistics_are_no_less_than_signed_ones(stage, state, views) -> None:
    """And equal where a Gaussian's gradient has one sign over all pixels that it touches: as it has where it touches one."""
    sums = []
    for gradient in ("ndc", "absolute"):
        engine = stage.engine(density=DensityOptions(gradient=gradient))
        engine.put(copy.deepcopy(state))
        engine.differentiate(1, chosen(stage, SETS[views]), DEGREE)
        sums.append(engine.take().gradient_sum - state.gradient_sum)
    signed, absolute = sums
    assert (absolute >= signed * (1 - LENGTHS)).all()
    assert absolute.sum() > 1.5 * signed.sum()
    assert np.array_equal(signed == 0, absolute == 0)


def test_each_stage_is_timed(stage, state) -> None:
    engine = stage.engine()
    engine.stopwatch = Stopwatch()
    trained(engine, state, stage.targets, DEGREE, last=1)
    assert list(engine.stopwatch.seconds) == ["posing", "drawing", "loss", "backward", "statistics", "Adam"]
    assert all(second > 0 for second in engine.stopwatch.seconds.values())


def test_nothing_can_be_taken_before_something_was_put(stage) -> None:
    with pytest.raises(ValueError, match="no state"):
        stage.engine().take()
