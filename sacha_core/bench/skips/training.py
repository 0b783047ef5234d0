"""What training leaves out beside pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sacha_core.bench.preset import Preset
from sacha_core.bench.scenes import cameras_around, made_avatar
from sacha_core.bench.skips.skip import Work, apart
from sacha_core.parallel.pool import Pool
from sacha_core.raster.harmonics import sh_rest_gradient
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.density_control import calibrate
from sacha_core.train.gradients import ViewColours
from sacha_core.train.importance import SeenWeights
from sacha_core.train.optimiser import Adam, Slopes
from sacha_core.train.options import DensityOptions, PruningOptions, TrainOptions
from sacha_core.train.regions import head_regions
from sacha_core.train.state import initial_state
from sacha_core.train.views import Target

__all__ = ["training_skips"]


def training_skips(preset: Preset) -> Iterator[Work]:
    """Give what an engine leaves out, with an avatar that was made."""
    n, views = preset.of(300, 20_000, 20_000), preset.of(2, 6, 16)
    avatar, head = made_avatar(n, 1, 2)
    motion, gaussians = avatar.motion, avatar.gaussians
    assert motion is not None
    options = TrainOptions(
        threads=preset.threads, density=DensityOptions(by_region=True), pruning=PruningOptions(scope="none")
    )
    regions = head_regions(head, options.scheme)
    bases = (options.density.threshold, options.pruning.ratio)
    sensitivity = np.random.default_rng(preset.seed).normal(size=n).astype(np.float32)
    state = initial_state(gaussians, motion, regions.n_regions, *bases)
    state.values["sensitivity_logit"][:] = sensitivity
    engine = CpuEngine(head, motion, options)
    engine.put(state)
    width, height = preset.of((55, 80), (275, 401), (550, 802))
    white, nothing = np.full((3, height, width), 255, np.uint8), np.zeros((height, width), np.uint8)
    targets = [
        Target(0, camera, white, nothing, (0, 0, 0, 0))
        for camera in cameras_around(head.v_template, views, width, height)
    ]

    def thresholds(seen: SeenWeights | None) -> np.ndarray:
        calibrate(state, options, regions, seen)
        return state.thresholds.copy()

    def looked() -> np.ndarray:
        return thresholds(SeenWeights(engine.weights(targets, 1), len(targets)))

    yield resting_coefficients(n, preset)
    yield Work(
        f"regions that calibration leaves alone: {views} views that nothing asks for", lambda: thresholds(None), looked,
        lambda: apart(thresholds(None), looked()), "tests/skips/test_skips_training.py::test_importance_pass",
    )  # fmt: skip


def resting_coefficients(n: int, preset: Preset) -> Work:
    """Step the harmonics in use, of degree 1; the plain way, all 15 coefficients of each Gaussian."""
    avatar, _ = made_avatar(n, 3, 1)
    assert avatar.motion is not None
    states = [initial_state(avatar.gaussians, avatar.motion, 1, 0.0, 0.0) for _ in range(2)]
    rng, centre, pool = np.random.default_rng(preset.seed), np.array([0.1, 0.2, 1.5], np.float32), Pool(preset.threads)
    means, cut = (rng.normal(size=(n, 3)).astype(np.float32) for _ in range(2))
    colours, rates = ViewColours(centre, cut), {"sh_rest": 1e-3}

    def active() -> None:
        Adam(pool).step(states[0], rates, Slopes({}, means, [colours], 1))

    def every() -> None:
        gradient = sh_rest_gradient(means, centre, 1, cut, 15)
        Adam(pool).step(states[1], rates, Slopes({"sh_rest": gradient}, means))

    def error() -> float:
        active()
        every()
        return apart(*(state.values["sh_rest"] for state in states))

    proof = "tests/skips/test_skips_training.py::test_coefficients_at_rest_in_adam"
    return Work("harmonics at rest, in Adam (degree 1 of 3 in use)", active, every, error, proof)
