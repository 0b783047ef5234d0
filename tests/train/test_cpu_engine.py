"""One view's gradients against finite differences of the whole chain, and views that show nothing."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.scene import render_avatar
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.options import LossOptions, TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, Arrays, TrainState, initial_state
from sacha_core.train.views import TrainingViews, box_of

# The loss is float32 and jumps where an alpha crosses 1/255 or two Gaussians change places in depth. Slopes over several steps, averaged,
# agree to this where the chain is right; a missing term is of the order of 1
AGREEMENT = 0.1
PIXELS = 0.05  # a step small beside the pictures of Gaussians
SUMS = 1e-6  # the same float32 terms, summed over other bands of rows
CROPPED = (
    1e-4  # relative to the largest; likewise, and SSIM's slope where images agree is a difference of equal numbers
)
WEIGHTS = 1e-5  # relative; float32 sums, and NumPy's pose beside the compiled one
CHANGES = 1e-4  # relative; likewise, and a change is a difference of pictures
MEANS = 1e-5  # relative; float32 sums over views, in another order
SMOOTH = LossOptions(l1=0.0)  # L1's kinks left out
DEGREE = 2
STEPS = {
    "position": 4e-3, "log_scale": 4e-3, "quaternion": 8e-3, "opacity_logit": 2e-2, "sensitivity_logit": 5e-2, "sh_dc": 2e-2,
    "sh_rest": 2e-2, "expression": 4e-2, "rotation": 6e-3, "neck": 6e-3, "translation": 1e-4,
}  # fmt: skip
SPREADS = {
    "position": 0.1, "log_scale": 0.3, "quaternion": 0.3, "sh_dc": 0.8, "sh_rest": 0.1, "rotation": 0.1, "neck": 0.1, "expression": 0.3,
}  # fmt: skip


@pytest.fixture
def scene(tiny):
    """Give a stage, a state away from all special values, and one target."""
    rng = np.random.default_rng(3)
    gaussians = initial_gaussians(tiny.head.n_faces, rng, DEGREE)
    state = initial_state(gaussians, tiny.capture.motion, 8, 3e-4, 0.2)
    for name, spread in SPREADS.items():
        state.values[name] += rng.normal(0, spread, state.values[name].shape).astype(np.float32)
    state.values["log_scale"] -= np.float32(0.9)  # few overlaps: where two swap their order in depth, the loss jumps
    state.values["opacity_logit"][:] = rng.normal(0.5, 1, len(state))
    state.values["sensitivity_logit"][:] = rng.normal(0, 1, len(state))
    engine = CpuEngine(tiny.head, tiny.capture.motion, TrainOptions(losses=SMOOTH, threads=1))
    return engine, state, TrainingViews(tiny.capture)[7]


@dataclass
class Outcome:
    """What one step's views say."""

    losses: dict[str, float]
    gradients: Arrays
    visible: np.ndarray
    image_gradient: np.ndarray


def judged(engine: CpuEngine, state: TrainState, *targets) -> Outcome:
    state.gradient_sum[:] = 0
    state.gradient_count[:] = 0
    engine.put(state)
    engine.differentiate(1, targets, DEGREE)
    assert engine.take().faults.count == 0
    return Outcome(engine.losses(), engine.gradients(), state.gradient_count > 0, state.gradient_sum.copy())


@pytest.mark.parametrize("name", STEPS)
def test_gradients_are_those_of_finite_differences(scene, name) -> None:
    engine, state, target = scene
    outcome = judged(engine, state, target)
    gradient = outcome.gradients[name].astype(np.float64)
    value = state.values[name]
    if name in FITTED_MOTION:
        value = value[target.timestep]
    start = value.copy()
    rng = np.random.default_rng(0)
    # half along the gradient, so that the slope is far from zero, and half at random
    direction = gradient / np.linalg.norm(gradient) + rng.normal(0, 1, start.shape) / np.sqrt(start.size)
    slopes = []
    for factor in (0.5, 0.7, 1.0, 1.4, 2.0):
        step, values = factor * STEPS[name], []
        for sign in (1, -1):
            value[:] = start + sign * step * direction
            values.append(judged(engine, state, target).losses["total"])
        slopes.append((values[0] - values[1]) / (2 * step))
    assert np.mean(slopes) == pytest.approx((gradient * direction).sum(), rel=AGREEMENT)


def test_the_gradient_that_growth_is_decided_by_is_in_normalised_device_units(scene) -> None:
    """Of one Gaussian alone: its mean moves in the image as the camera's principal point does, by finite differences."""
    engine, state, target = scene
    alone = int(np.argmax(judged(engine, state, target).image_gradient))
    opacity = state.values["opacity_logit"][alone]
    state.values["opacity_logit"][:] = -20
    state.values["opacity_logit"][alone] = opacity
    image, camera = (
        np.full((3, 48, 96), 255, np.uint8),
        target.camera,
    )  # wider than high, and most of it is cropped away
    image[:, :, :48] = target.image
    sensitivity = np.pad(target.sensitivity, ((0, 0), (0, 48)))
    wide = replace(target, camera=replace(camera, width=96), image=image, sensitivity=sensitivity)
    outcome = judged(engine, state, wide)
    slopes = []
    for axis, side in (("cx", 96), ("cy", 48)):
        ends = []
        for step in (PIXELS, -PIXELS):
            moved = replace(wide, camera=replace(wide.camera, **{axis: getattr(camera, axis) + step}))
            ends.append(judged(engine, state, moved).losses["total"])
        slopes.append((ends[0] - ends[1]) / (2 * PIXELS) * side / 2)
    assert outcome.image_gradient[alone] == pytest.approx(np.hypot(*slopes), rel=AGREEMENT)
    assert not np.delete(outcome.image_gradient, alone).any()


@pytest.mark.parametrize("corner", [(60, 40), (0, 0), (100, 120), (30, 0)])
def test_a_cropped_view_costs_and_teaches_what_the_whole_one_does(scene, corner) -> None:
    engine, state, target = scene
    left, top = corner
    size = 48
    camera = replace(target.camera, width=148, height=168, cx=target.camera.cx + left, cy=target.camera.cy + top)
    image, sensitivity = np.full((3, 168, 148), 255, np.uint8), np.zeros((168, 148), np.uint8)
    image[:, top : top + size, left : left + size] = target.image
    sensitivity[top : top + size, left : left + size] = target.sensitivity
    image[:, 90:100, 110:125] = target.image[
        :, 20:30, 15:30
    ]  # where no Gaussian is, so that it alone decides the crop's edge
    box = box_of((image != 255).any(axis=0) | (sensitivity != 0))
    placed = replace(target, camera=camera, image=image, sensitivity=sensitivity, box=box)
    part = judged(engine, state, placed)
    whole = judged(engine, state, replace(placed, box=(0, 0, 148, 168)))
    for name, value in whole.losses.items():
        assert part.losses[name] == pytest.approx(value, abs=SUMS), name
    assert np.array_equal(part.visible, whole.visible)
    slopes = part.gradients | {"image": part.image_gradient}
    for name, gradient in (whole.gradients | {"image": whole.image_gradient}).items():
        assert np.abs(slopes[name] - gradient).max() <= CROPPED * np.abs(gradient).max(), name


def test_a_view_without_gaussians_costs_what_white_costs_and_pulls_nowhere(scene) -> None:
    engine, state, target = scene
    state.values["opacity_logit"][:] = -20
    outcome = judged(engine, state, target)
    white = np.abs(target.image / 255 - 1).mean()
    assert outcome.losses["l1"] == pytest.approx(white, rel=1e-5)
    assert not outcome.visible.any()
    for name, gradient in outcome.gradients.items():
        assert not gradient.any(), name
    assert outcome.losses["position"] == outcome.losses["scale"] == 0


def test_a_camera_that_looks_away_sees_nothing(scene) -> None:
    engine, state, target = scene
    camera = target.camera
    away = replace(
        camera,
        rotation=camera.rotation * np.array([[1], [-1], [-1]]),
        translation=camera.translation * np.array([1, -1, -1]),
    )
    blank = {
        "image": np.full_like(target.image, 255),
        "sensitivity": np.zeros_like(target.sensitivity),
        "box": (0, 0, 0, 0),
    }
    nothing = replace(target, camera=away, **blank)
    outcome = judged(engine, state, nothing)
    assert outcome.losses["l1"] == 0
    assert all(np.isfinite(gradient).all() for gradient in outcome.gradients.values())


def test_the_loss_of_sensitivity_ends_when_it_is_told_to(tiny, scene) -> None:
    """The oracle: an engine without that loss."""
    _, state, target = scene
    schedule = replace(TrainOptions().schedule, sensitivity_until=5)
    ending, without = (
        CpuEngine(tiny.head, tiny.capture.motion, replace(TrainOptions(threads=1), losses=losses, schedule=schedule))
        for losses in (LossOptions(), LossOptions(sensitivity=0))
    )
    found = {}
    for iteration in (5, 6):
        for engine in (ending, without):
            engine.put(state)
            engine.differentiate(iteration, [target], DEGREE)
            found[iteration, engine] = engine.gradients()
    assert found[5, ending]["sensitivity_logit"].any()
    assert not found[6, ending]["sensitivity_logit"].any()
    for name, gradient in found[6, ending].items():
        assert np.array_equal(gradient, found[6, without][name])


def test_penalties_are_the_means_of_the_method(scene) -> None:
    engine, state, target = scene
    state.values["position"][:] = np.float32([1.5, 0, 0])
    state.values["log_scale"][:] = np.log(np.float32([0.7, 0.5, 0.6]))
    outcome = judged(engine, state, target)
    assert outcome.visible.any()
    assert outcome.losses["position"] == pytest.approx(0.01 * 0.5, rel=1e-5)
    assert outcome.losses["scale"] == pytest.approx(1.0 * 0.1, rel=1e-5)


def test_summed_weights_are_what_covers_the_background(tiny, scene) -> None:
    engine, state, target = scene
    engine.put(state)
    weights = engine.weights([target], DEGREE)
    frames = triangle_frames(Poser(tiny.head, state.motion(tiny.capture.motion))(target.timestep), tiny.head.faces)
    alpha = render_avatar(state.gaussians(), frames, target.camera).alpha
    assert weights[:, 0].sum() == pytest.approx(float(alpha.sum(dtype=np.float64)), rel=WEIGHTS)
    assert (weights[:, 1] <= weights[:, 0] * (1 + 1e-6)).all()


def test_removals_are_what_pictures_change_by(tiny, scene) -> None:
    """Drawn again without the Gaussian, by the player; what the last iteration left for the next step stays as it is."""
    engine, state, target = scene
    before = judged(engine, state, target).gradients
    changes = engine.removals([target], DEGREE)
    assert all(np.array_equal(before[name], gradient) for name, gradient in engine.gradients().items())
    assert changes.shape == (len(state), 4)
    frames = triangle_frames(Poser(tiny.head, state.motion(tiny.capture.motion))(target.timestep), tiny.head.faces)

    def picture() -> np.ndarray:
        return render_avatar(state.gaussians(), frames, target.camera, sh_degree=DEGREE).colour.astype(np.float64)

    whole, sensitive = picture(), target.sensitivity[:, :, None] / 255
    for row in np.argsort(-changes[:, 0])[:8].tolist():
        opacity = state.values["opacity_logit"][row]
        state.values["opacity_logit"][row] = -20
        change = picture() - whole
        state.values["opacity_logit"][row] = opacity
        expected = [(part * weight).sum() for part in (change**2, abs(change)) for weight in (1, sensitive)]
        assert changes[row] == pytest.approx(expected, rel=CHANGES)
    assert engine.removals([target, target], DEGREE) == pytest.approx(2 * changes)


def test_removals_of_a_timestep_that_cannot_be_drawn_are_none(scene) -> None:
    engine, state, target = scene
    engine.put(state)
    state.values["sh_dc"][3] = np.nan
    assert not engine.removals([target], DEGREE).any()
    assert engine.weights([target], DEGREE).any()  # which has no colours
    state.values["neck"][target.timestep] = np.nan
    assert not engine.removals([target], DEGREE).any()


def test_several_cameras_at_once_are_the_mean_of_each_alone(tiny, scene) -> None:
    engine, state, _ = scene
    views = TrainingViews(tiny.capture)
    targets = [views[index] for index in (6, 8, 11)]
    alone = [judged(engine, state, target) for target in targets]
    together = judged(engine, state, *targets)
    for name, value in together.losses.items():
        assert value == pytest.approx(np.mean([one.losses[name] for one in alone]), rel=MEANS), name
    for name, gradient in together.gradients.items():
        mean = np.mean([one.gradients[name] for one in alone], axis=0)
        assert np.abs(gradient - mean).max() <= MEANS * np.abs(mean).max(), name
    total = np.sum([one.image_gradient for one in alone], axis=0)
    assert together.image_gradient == pytest.approx(total, abs=MEANS * float(total.max()))
    assert np.array_equal(state.gradient_count, np.sum([one.visible for one in alone], axis=0))


def run_on(engine: CpuEngine, state: TrainState, targets, looks: bool) -> None:
    """Do an iteration for each target; who looks at the state in between has each step taken for itself, not with the next placing."""
    rates = dict.fromkeys((*state.values,), 1e-3)
    for iteration, target in enumerate(targets, 1):
        engine.differentiate(iteration, [target], DEGREE)
        engine.advance(rates, frozenset())
        if looks:
            engine.take()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("unposable", [None, 2])
def test_steps_joined_with_placing_are_those_taken_for_themselves(tiny, scene, threads, unposable) -> None:
    """To the bit, also where the next iteration cannot pose the head."""
    _, state, _ = scene
    views, states = TrainingViews(tiny.capture), []
    targets = [views[index] for index in (7, 2, 11, 7)]
    if unposable is not None:
        state.values["neck"][targets[unposable].timestep] = np.nan
    for looks in (True, False):
        own = deepcopy(state)
        engine = CpuEngine(tiny.head, tiny.capture.motion, TrainOptions(threads=threads))
        engine.put(own)
        run_on(engine, own, targets, looks)
        states.append(engine.take())
    one, other = states
    assert one.faults == other.faults
    assert one.faults.count == (
        0 if unposable is None else sum(t.timestep == targets[unposable].timestep for t in targets)
    )
    assert not np.array_equal(one.values["position"], state.values["position"])
    for kind in ("values", "first", "second"):
        for name, array in getattr(one, kind).items():
            assert np.array_equal(array, getattr(other, kind)[name], equal_nan=True), (kind, name)


def test_a_state_from_anywhere_lies_in_one_piece_once_it_is_trained_on(scene) -> None:
    engine, state, _ = scene
    scattered = deepcopy(state)
    before = {name: array.copy() for name, array in scattered.values.items()}
    engine.put(scattered)
    rows = [kind[name] for kind in (scattered.values, scattered.first, scattered.second) for name in ATTRIBUTES]
    assert len({id(array.base) for array in rows}) == 1
    for name, array in before.items():
        assert np.array_equal(scattered.values[name], array)
    arrays = dict(scattered.values)
    engine.put(scattered)
    assert all(scattered.values[name] is array for name, array in arrays.items())  # and stays there
