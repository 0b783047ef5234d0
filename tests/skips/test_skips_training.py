"""What training leaves out changes no bit. Oracle: the same step with nothing left out."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.modulators import bounded
from sacha_core.parallel.pool import Pool
from sacha_core.perception.image_loss import ImageLoss
from sacha_core.raster.harmonics import sh_rest_gradient
from sacha_core.train.density_control import calibrate
from sacha_core.train.gradients import ViewColours
from sacha_core.train.importance import SeenWeights
from sacha_core.train.optimiser import Adam, Slopes
from sacha_core.train.options import DensityOptions, PruningOptions, TrainOptions
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, initial_state

N, REGIONS = 400, 4
REACH = 10  # pixels: of a pixel in another's gradient of SSIM


def state_of(sensitivity_logit: np.ndarray, sh_degree: int = 1) -> TrainState:
    rng = np.random.default_rng(0)
    shapes = {"position": 3, "log_scale": 3, "quaternion": 4, "sh_dc": 3}
    arrays = {name: rng.normal(size=(N, width)).astype(np.float32) for name, width in shapes.items()}
    binding = np.sort(rng.integers(0, 40, N)).astype(np.int32)
    opacity, rest = (
        rng.normal(size=N).astype(np.float32),
        rng.normal(size=(N, (sh_degree + 1) ** 2 - 1, 3)).astype(np.float32),
    )
    gaussians = Gaussians(
        **arrays, opacity_logit=opacity, sh_rest=rest, binding=binding, sensitivity_logit=sensitivity_logit
    )
    return initial_state(gaussians, Motion.rest(0, 2, 3), REGIONS, DensityOptions().threshold, PruningOptions().ratio)


def test_pixels_that_agree() -> None:
    """Each row is looked at only between its first and its last difference; with differences at both ends the rest keeps its bits."""
    height, width = 90, 300
    rng = np.random.default_rng(1)
    target = rng.integers(0, 256, (3, height, width), np.uint8)
    image = target * np.float32(1 / 255)
    image[:, 30:60, 130:170] += rng.normal(0, 0.1, (3, 30, 40)).astype(np.float32)
    few = ImageLoss()(image, target)
    gradient, costs = few.gradient.copy(), few.l1
    assert 0.1 < (gradient != 0).mean() < 0.2
    image[:, :, [0, -1]] += np.float32(0.5)
    all_of_it = ImageLoss()(image, target)
    assert (all_of_it.gradient != 0).mean() > (gradient != 0).mean() + 0.05
    middle = np.s_[:, :, REACH + 1 : -REACH - 1]
    assert np.array_equal(all_of_it.gradient[middle], gradient[middle])
    assert all_of_it.l1 > costs > 0


def test_coefficients_at_rest_in_adam() -> None:
    """Harmonics beyond the degree in use have neither gradient nor moments: to leave them out gives the bits of stepping them all."""
    rng = np.random.default_rng(4)
    means, cut = (rng.normal(size=(N, 3)).astype(np.float32) for _ in range(2))
    centre, rates, pool = np.array([0.1, 0.2, 1.5], np.float32), {"sh_rest": 1e-3}, Pool(2)
    some, every = (state_of(np.zeros(N, np.float32), sh_degree=3) for _ in range(2))
    assert np.array_equal(some.values["sh_rest"], every.values["sh_rest"])
    before = some.values["sh_rest"].copy()
    for _ in range(3):
        Adam(pool).step(some, rates, Slopes({}, means, [ViewColours(centre, cut)], 1))
        gradient = sh_rest_gradient(means, centre, 1, cut, 15)
        Adam(pool).step(every, rates, Slopes({"sh_rest": gradient}, means))
    for kind in ("values", "first", "second"):
        assert np.array_equal(getattr(some, kind)["sh_rest"], getattr(every, kind)["sh_rest"]), kind
    assert (some.values["sh_rest"][:, :3] != before[:, :3]).mean() > 0.99
    assert np.array_equal(some.values["sh_rest"][:, 3:], before[:, 3:])


def test_importance_pass() -> None:
    """Thresholds and ratios of plain means are the same whether or not a hundred views were drawn to see what shows."""
    rng = np.random.default_rng(2)
    logits = rng.normal(size=N).astype(np.float32)
    regions = Regions(rng.integers(0, REGIONS, 40).astype(np.uint8), REGIONS)
    options = TrainOptions(density=DensityOptions(by_region=True), pruning=PruningOptions(scope="none"))
    seen = SeenWeights(rng.uniform(0, 20, (N, 2)) * (rng.random((N, 1)) < 0.5), 100)
    looked, plain = state_of(logits), state_of(logits)
    calibrate(looked, options, regions, seen)
    calibrate(plain, options, regions, None)
    assert np.array_equal(looked.thresholds, plain.thresholds)
    assert np.array_equal(looked.ratios, plain.ratios)
    assert np.ptp(plain.thresholds) > 0


@given(st.floats(1e-6, 1), st.floats(0.1, 1), st.floats(1, 10))
def test_regions_that_calibration_leaves_alone(base: float, down: float, up: float) -> None:
    """Where all are equally sensitive every modulator is 1, and the threshold is the base's own bits, not a product of roundings."""
    assert np.array_equal(bounded(base, np.ones(3), base * down, base * up), np.full(3, base))


def test_equal_sensitivities_leave_every_region_alone() -> None:
    options = TrainOptions(density=DensityOptions(by_region=True), pruning=PruningOptions(scope="regions"))
    state = state_of(np.full(N, -2.2, np.float32))
    regions = Regions(np.random.default_rng(3).integers(0, REGIONS, 40).astype(np.uint8), REGIONS)
    event = calibrate(state, options, regions, None)
    assert event.modulator == (1.0,) * REGIONS
    assert np.array_equal(state.thresholds, np.full(REGIONS, options.density.threshold))
    assert np.array_equal(state.ratios, np.full(REGIONS, options.pruning.ratio))
