"""Learnt masks: their gradient against differences of the relaxed form, what they hide, and whole runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.density.events import MaskPruning
from sacha_core.errors import OptionError
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.cuda.offered import require_offered
from sacha_core.train.loop import train
from sacha_core.train.masks import LOWEST, alive, mask_gradient, mask_penalty
from sacha_core.train.options import LossOptions, TrainOptions
from sacha_core.train.presets import scaled
from sacha_core.train.state import MASK_LOGIT, initial_state
from sacha_core.train.views import TrainingViews

STEP = 1e-6  # of central differences in float64
AGREEMENT = 1e-6  # relative: cut and rounding of such differences
FAINT = 1e-3  # relative: a sigmoid near 0 in float32
WEIGHT = 0.3
STRONG = 0.005  # of the penalty, so that some masks close within 60 iterations, and not all


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


@given(st.integers(0, 2**32), st.integers(1, 20))
@settings(deadline=None)
def test_the_gradient_is_that_of_the_relaxed_mask(seed, n) -> None:
    """The oracle: a smooth loss of what is drawn, with opacity m o and scales m s, in float64, by central differences of m at 1."""
    rng = np.random.default_rng(seed)
    logit, opacity_logit, log_scale = rng.normal(0, 2, n), rng.normal(0, 2, n), rng.normal(0, 1, (n, 3))
    a, b = rng.normal(0, 1, n), rng.normal(0, 1, (n, 3))

    def loss(mask, u, scale):
        x, y = mask * sigmoid(u), mask[:, None] * np.exp(scale)
        return np.sum(np.sin(a * x)) + np.sum(np.cos(b * y)) + np.sum(x * y.prod(axis=1))

    def slope(of, i, *where):
        at = [0.0, 0.0]
        for k, sign in enumerate((1, -1)):
            moved = [w.copy() for w in where]
            moved[of].reshape(-1)[i] += sign * STEP
            at[k] = loss(*moved)
        return (at[0] - at[1]) / (2 * STEP)

    here = (np.ones(n), opacity_logit, log_scale)
    slopes = {
        "opacity_logit": np.array([slope(1, i, *here) for i in range(n)]),
        "log_scale": np.array([slope(2, i, *here) for i in range(3 * n)]).reshape(n, 3),
    }
    by_mask = np.array([slope(0, i, *here) for i in range(n)])
    m = sigmoid(logit)
    expected = (by_mask + WEIGHT / n) * m * (1 - m)
    found = mask_gradient(logit, sigmoid(opacity_logit), slopes, WEIGHT)
    # the penalty's weight is float32's; opacities near 1 lose digits of the difference
    assert found == pytest.approx(expected, rel=1e-4, abs=AGREEMENT)


def test_the_penalty_is_the_mean_and_its_gradient_the_difference() -> None:
    logit = np.linspace(-6, 4, 11)
    none = {"opacity_logit": np.zeros(11), "log_scale": np.zeros((11, 3))}
    for i in range(11):
        up, down = logit.copy(), logit.copy()
        up[i] += STEP
        down[i] -= STEP
        expected = (mask_penalty(up, WEIGHT) - mask_penalty(down, WEIGHT)) / (2 * STEP)
        assert mask_gradient(logit, np.full(11, 0.5), none, WEIGHT)[i] == pytest.approx(expected, rel=1e-4)
    assert mask_penalty(np.zeros(0), WEIGHT) == 0


def test_masks_hide_at_a_hundredth() -> None:
    edge = np.log(LOWEST / (1 - LOWEST))
    assert alive(np.array([edge + 1e-9, edge - 1e-9, 1.0, -90.0])).tolist() == [True, False, True, False]


def test_what_a_mask_hides_is_not_drawn_and_learns_from_the_penalty_alone(tiny) -> None:
    """The oracle: the same state without those Gaussians."""
    made = TrainOptions(losses=LossOptions(mask=WEIGHT), threads=1, device="cpu")
    gaussians = initial_gaussians(tiny.head.n_faces, np.random.default_rng(0), 1)
    state = initial_state(gaussians, tiny.capture.motion, 8, 3e-4, 0.2, mask_logit=1.0)
    hidden = np.arange(len(state)) % 3 == 0
    state.values[MASK_LOGIT][hidden] = -9
    fewer = initial_state(gaussians.select(np.flatnonzero(~hidden)), tiny.capture.motion, 8, 3e-4, 0.2)
    target = TrainingViews(tiny.capture)[7]
    found = []
    for one, options in ((state, made), (fewer, replace(made, losses=LossOptions()))):
        engine = CpuEngine(tiny.head, tiny.capture.motion, options)
        engine.put(one)
        engine.differentiate(1, [target], 0)
        found.append((engine.losses(), engine.gradients()))
    (with_masks, slopes), (without, expected) = found
    assert with_masks["l1"] == without["l1"]
    assert with_masks["mask"] == pytest.approx(mask_penalty(state.values[MASK_LOGIT], WEIGHT), rel=1e-6)
    assert np.array_equal(slopes["position"][~hidden], expected["position"])
    for name in ("position", "log_scale", "opacity_logit", "sh_dc"):
        assert not slopes[name][hidden].any()
    m = sigmoid(-9.0)
    assert slopes[MASK_LOGIT][hidden] == pytest.approx(WEIGHT / len(state) * m * (1 - m), rel=FAINT)


def masked(iterations: int = 60, **changes) -> TrainOptions:
    """Give a short run in which masks close quickly."""
    made = scaled(iterations, "mask", TrainOptions(threads=1, sh_degree=1, device="cpu", **changes))
    schedule = replace(made.schedule, densify_every=10)
    rates, losses = replace(made.rates, mask_logit=0.5), replace(made.losses, mask=STRONG)
    return replace(made, rates=rates, losses=losses, schedule=schedule)


def test_a_run_with_masks_resumes_to_the_bit_and_leaves_nothing_hidden(tiny, tmp_path) -> None:
    whole = train(tiny.capture, tiny.head, masked(), tmp_path / "whole")
    pruned = [event for event in whole.events if isinstance(event, MaskPruning)]
    assert pruned[-1].iteration == 60
    assert any(sum(event.removed) for event in pruned)
    for event in pruned:
        assert tuple(b - r for b, r in zip(event.before, event.removed, strict=True)) == event.after
    assert len(whole.gaussians) == sum(pruned[-1].after)

    def stop(progress) -> None:
        if progress.stage == "train" and progress.done >= 31:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            train(tiny.capture, tiny.head, replace(masked(), threads=2), tmp_path / "cut", stop)
    again = train(tiny.capture, tiny.head, replace(masked(), threads=3), tmp_path / "cut")
    assert again.events == whole.events
    for name in ("position", "log_scale", "opacity_logit", "sh_rest"):
        assert np.array_equal(getattr(again.gaussians, name), getattr(whole.gaussians, name))


def test_masks_that_weigh_nothing_are_not_learnt_and_cuda_says_that_it_has_none(tiny, tmp_path) -> None:
    with pytest.raises(OptionError, match=r"^losses\.mask is 0\.005, expected 0 on cuda"):
        require_offered(masked())
    made = TrainOptions()
    with pytest.raises(OptionError, match=r"^schedule\.sensitivity_until is 7, expected none on cuda"):
        require_offered(replace(made, schedule=replace(made.schedule, sensitivity_until=7)))
    plain = train(tiny.capture, tiny.head, scaled(20, "default", TrainOptions(threads=1, device="cpu")), tmp_path)
    assert not any(isinstance(event, MaskPruning) for event in plain.events)


def test_a_run_without_masks_does_not_go_on_with_them(tiny, tmp_path) -> None:
    train(tiny.capture, tiny.head, replace(masked(20), losses=LossOptions()), tmp_path)
    with pytest.raises(OptionError, match=r"another losses\.mask"):
        train(tiny.capture, tiny.head, masked(20), tmp_path)
