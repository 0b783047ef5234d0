"""What scores are made of: passes over views add up, and every score can be pruned by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians, sigmoid
from sacha_core.density.events import Pruning
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.scores_file import read_scores
from sacha_core.train.cpu_engine import CpuEngine
from sacha_core.train.importance import PASSES, importance, look
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import SCORES
from sacha_core.train.presets import scaled
from sacha_core.train.state import initial_state
from sacha_core.train.views import TrainingViews

SUMS = 1e-12  # float64 sums in another order
DIGITS = 1e-5  # scores are rounded to six
OPTIONS = TrainOptions(threads=1, sh_degree=1, device="cpu")


@pytest.fixture
def seen(tiny):
    """Give a state, and what four views of two timesteps tell of it."""
    gaussians = initial_gaussians(tiny.head.n_faces, np.random.default_rng(1), 1)
    state = initial_state(gaussians, tiny.capture.motion, 8, 3e-4, 0.2)
    state.values["opacity_logit"][:] = 1
    state.values["sh_dc"][:] = np.random.default_rng(3).normal(size=state.values["sh_dc"].shape)
    state.values["sensitivity_logit"][:] = np.random.default_rng(2).normal(size=len(state))
    engine, views = CpuEngine(tiny.head, tiny.capture.motion, OPTIONS), TrainingViews(tiny.capture)
    engine.put(state)
    by_timestep: dict[int, list] = {}
    for index in range(len(views)):
        by_timestep.setdefault(views[index].timestep, []).append(views[index])
    steps = [targets[:2] for targets in by_timestep.values()][:2]
    return state, engine, steps, look(engine, steps, 4, 1, tuple(PASSES))


def test_passes_are_summed_over_views(seen) -> None:
    _, engine, steps, found = seen
    for name in PASSES:
        alone = [PASSES[name](engine, [target], 1) for targets in steps for target in targets]
        assert np.any(found.more[name])
        assert found.more[name] == pytest.approx(np.sum(alone, axis=0), rel=SUMS, abs=SUMS)


@pytest.mark.parametrize(("score", "columns"), [("removal", 0), ("removal-absolute", 2)])
def test_removal_scores_take_the_change_that_they_are_named_for(seen, score, columns) -> None:
    state, _, _, found = seen
    factors = replace(OPTIONS.importance, pixel_factor=0.5, gaussian_factor=2.0)
    options = replace(OPTIONS, pruning=replace(OPTIONS.pruning, score=score), importance=factors)
    plain, sensitive = found.more["removal"][:, columns : columns + 2].T
    expected = (plain + 0.5 * sensitive) * (1 + 2 * sigmoid(state.values["sensitivity_logit"].astype(np.float64)))
    given = importance(state, options, found, np.ones(80))
    assert given == pytest.approx(expected, rel=DIGITS)
    assert len(np.unique(given)) > len(state) / 4


@pytest.mark.parametrize("score", KNOWN_SCORES)
def test_training_prunes_by_every_score(tiny, tmp_path, score) -> None:
    options = scaled(30, "default-gp-pis", OPTIONS)
    options = replace(options, pruning=replace(options.pruning, score=score, ratio=0.5))
    model = train(tiny.capture, tiny.head, options, tmp_path)
    prunings = [event for event in model.events if isinstance(event, Pruning)]
    assert prunings
    assert all(event.score == score and sum(event.removed) == sum(event.before) // 2 for event in prunings)
    stored = read_scores(tmp_path / SCORES).score
    assert np.isfinite(stored).all()
    assert stored.max() > 0
