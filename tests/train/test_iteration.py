"""Single iterations against the method's numbers: what moves, how far, and what waits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.progress import silent
from sacha_core.train.loop import Run
from sacha_core.train.options import Schedule, TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION

ITERATIONS = 400
DECAY = 0.01 ** (1 / ITERATIONS)  # of the position's rate in one iteration: from 0.005 to 0.00005
# The ball's cameras stand 0.5 m from the axis, 0.15 m above and below the middle
EXTENT_M = 1.1 * 0.5 * np.hypot(1, 0.3)
RATES = {
    "position": 0.005 * EXTENT_M * DECAY, "log_scale": 0.017, "quaternion": 1e-3, "opacity_logit": 0.05, "sensitivity_logit": 1e-4,
    "sh_dc": 0.0025, "sh_rest": 0.0025 / 20, "rotation": 1e-5, "neck": 1e-5, "jaw": 1e-5, "eyes": 1e-5, "translation": 1e-6,
    "expression": 1e-3,
}  # fmt: skip
NOTICEABLE = 1e-12  # gradients far above Adam's epsilon of 1e-15
STEP = 2e-3  # relative: a step of 1e-4 added to a logit of 2.2 in float32
NEVER = 10**6
QUIET = Schedule(
    iterations=ITERATIONS, position_decay=ITERATIONS, sh_every=NEVER, densify_from=0, densify_every=NEVER,
    densify_until=ITERATIONS, warm_up=NEVER, calibrations=(), opacity_resets=(), size_prune_from=NEVER,
)  # fmt: skip


@pytest.fixture
def begin(tiny, tmp_path):
    """Give a function that begins a run of an otherwise quiet schedule."""

    def begun(**schedule) -> Run:
        options = TrainOptions(threads=1, sh_degree=1, device="cpu", schedule=replace(QUIET, **schedule))
        run = Run(tiny.capture, tiny.head, options, tmp_path, silent)
        run.begin(resume=False, start_from=None)
        return run

    return begun


def copies(run: Run) -> dict[str, np.ndarray]:
    return {name: value.copy() for name, value in run.engine.take().values.items()}


def test_the_first_step_is_each_rate_long(begin) -> None:
    """From no moments Adam goes by its rate in the sign of the gradient, however small that is."""
    run = begin(sh_every=1)
    before = copies(run)
    run.iterate()
    for name, rate in RATES.items():
        gradient = run.engine.take().first[name] / np.float32(0.1)
        step = run.engine.take().values[name] - before[name]
        clear = np.abs(gradient) > NOTICEABLE
        assert clear.any() or name in {"jaw", "eyes"}, name  # the ball has neither
        assert step[clear] == pytest.approx(-rate * np.sign(gradient[clear]), rel=STEP), name
        assert not step[gradient == 0].any(), name


def test_the_degree_of_harmonics_grows_with_the_iteration_that_reaches_it(begin) -> None:
    run = begin(sh_every=3)
    changed = []
    for _ in range(4):
        before = run.engine.take().values["sh_rest"].copy()
        run.iterate()
        changed.append(not np.array_equal(run.engine.take().values["sh_rest"], before))
    assert changed == [False, False, True, True]


def test_statistics_are_of_those_in_view(begin) -> None:
    run = begin()
    run.engine.take().values["opacity_logit"][::2] = -9  # too faint to be drawn
    for _ in range(3):
        run.iterate()
    assert not run.engine.take().gradient_count[::2].any()
    assert not run.engine.take().gradient_sum[::2].any()
    assert (run.engine.take().gradient_count[1::2] == 3).all()
    assert (run.engine.take().gradient_sum[1::2] > 0).all()


def test_gaussians_wait_while_densification_changes_their_rows_and_the_motion_does_not(begin) -> None:
    run = begin(densify_every=2)
    run.engine.take().thresholds[:] = np.inf  # so that rows stay what they are
    run.iterate()
    before, moments = copies(run), {name: run.engine.take().first[name].copy() for name in ATTRIBUTES}
    run.iterate()
    for name in ATTRIBUTES:
        assert np.array_equal(run.engine.take().values[name], before[name]), name
        assert np.array_equal(run.engine.take().first[name], moments[name]), name
    assert run.engine.take().steps == {"gaussians": 1, "motion": 2}
    assert any(not np.array_equal(run.engine.take().values[name], before[name]) for name in FITTED_MOTION)
    assert not run.engine.take().gradient_count.any()
    run.iterate()
    assert not np.array_equal(run.engine.take().values["position"], before["position"])


def test_opacities_wait_while_they_are_reset_and_nothing_else_does(begin) -> None:
    run = begin(opacity_resets=(2,))
    run.iterate()
    before = copies(run)
    run.iterate()
    assert run.engine.take().values["opacity_logit"] == pytest.approx(np.log(0.01 / 0.99), rel=1e-6)
    assert not run.engine.take().first["opacity_logit"].any()
    assert not run.engine.take().second["opacity_logit"].any()
    for name in ("position", "log_scale", "sh_dc", "sensitivity_logit"):
        assert not np.array_equal(run.engine.take().values[name], before[name]), name


def test_without_fine_tuning_the_motion_stays_as_tracked(tiny, tmp_path) -> None:
    run = Run(
        tiny.capture,
        tiny.head,
        TrainOptions(threads=1, fine_tune=False, device="cpu", schedule=QUIET),
        tmp_path,
        silent,
    )
    run.begin(resume=False, start_from=None)
    before = copies(run)
    run.iterate()
    assert all(np.array_equal(run.engine.take().values[name], before[name]) for name in FITTED_MOTION)
    assert not np.array_equal(run.engine.take().values["position"], before["position"])
