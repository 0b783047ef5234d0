"""Whole runs on the tiny capture: they learn, resume to the bit, branch, and refuse what does not belong to them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.density.events import Calibration, Densification, OpacityReset, Pruning, parse_events
from sacha_core.density.scores_file import read_scores
from sacha_core.errors import DatasetError, HeadError, OptionError
from sacha_core.interchange.gaussian_avatars import read_model
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.output import CHECKPOINT, EVENTS, SCORES, WARM_UP_CHECKPOINT
from sacha_core.train.presets import scaled

ITERATIONS = 40
BASE = replace(TrainOptions(), threads=1, sh_degree=1)


def options(variant: str = "sacha", iterations: int = ITERATIONS, **changes) -> TrainOptions:
    """Give a short run with every kind of event: two calibrations, densifications, resets."""
    made = scaled(iterations, variant, replace(BASE, **changes))
    end = {"densify_until": 24} if variant == "sacha" else {}
    schedule = replace(made.schedule, calibrations=(12, 24), densify_every=4, densify_from=3, **end)
    return replace(
        made,
        schedule=schedule,
        density=replace(made.density, threshold=2e-3, threshold_lowest=1e-3, threshold_highest=4e-3),
    )


def model_bytes(folder: Path) -> dict[str, bytes]:
    """Give every file of a finished run but those that tell how it was run."""
    files = [
        p
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name not in {"options.json", CHECKPOINT, WARM_UP_CHECKPOINT}
    ]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


class InterruptedTrainingError(Exception):
    """Stands for the user's patience."""


def interrupt_after(iteration: int):
    def report(progress) -> None:
        if progress.stage == "train" and progress.done >= iteration:
            raise InterruptedTrainingError

    return report


@pytest.fixture(scope="module")
def finished(tiny, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    train(tiny.capture, tiny.head, options(), folder)
    return folder


def test_a_resumed_run_ends_in_the_same_bytes_whatever_the_threads(tiny, finished, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
    interrupted = replace(options(), threads=3, checkpoint_every=20)
    with pytest.raises(InterruptedTrainingError):
        train(tiny.capture, tiny.head, interrupted, tmp_path, interrupt_after(27))
    assert (tmp_path / CHECKPOINT).exists()
    assert not (tmp_path / "point_cloud").exists()
    train(tiny.capture, tiny.head, replace(interrupted, threads=2, checkpoint_every=7), tmp_path)
    assert model_bytes(tmp_path) == model_bytes(finished)


def test_a_finished_run_is_not_run_again_but_written_again(tiny, finished) -> None:
    before = model_bytes(finished)
    stages = set()
    train(tiny.capture, tiny.head, options(), finished, lambda progress: stages.add(progress.stage))
    assert model_bytes(finished) == before
    assert stages == set()


def test_a_branch_from_a_shared_warm_up_is_the_run_itself(tiny, finished, tmp_path) -> None:
    train(tiny.capture, tiny.head, options("default"), tmp_path / "default")
    start = tmp_path / "default" / WARM_UP_CHECKPOINT
    train(tiny.capture, tiny.head, options("sacha"), tmp_path / "sacha", start_from=start)
    assert model_bytes(tmp_path / "sacha") == model_bytes(finished)
    assert model_bytes(tmp_path / "default") != model_bytes(finished)


def test_what_lies_in_the_folder(tiny, finished) -> None:
    gaussians, motion = read_model(finished)
    scores = read_scores(finished / SCORES)
    events = parse_events((finished / EVENTS).read_text(encoding="utf-8"))
    assert from_record(json.loads((finished / "options.json").read_text(encoding="utf-8"))) == options()
    assert json.loads((finished / "head.json").read_text(encoding="utf-8"))["sha256"] == tiny.head.reference.sha256
    assert gaussians.sensitivity_logit is not None
    assert motion is not None
    assert {type(event) for event in events} == {Calibration, Densification, OpacityReset, Pruning}
    for event in events:
        if isinstance(event, Pruning):
            assert tuple(b - g for b, g in zip(event.before, event.removed, strict=True)) == event.after
            assert event.requested == event.removed  # no guard
        if isinstance(event, Densification):
            parts = zip(event.before, event.cloned, event.split, event.removed, strict=True)
            assert tuple(b + c + s - g for b, c, s, g in parts) == event.after
    last = next(event for event in reversed(events) if isinstance(event, Pruning))
    assert len(scores.gaussians) == sum(last.before)
    assert len(gaussians) == sum(last.after)  # growth has stopped
    assert scores.n_faces == tiny.head.n_faces


def test_calibration_comes_before_pruning_and_both_before_densification(finished) -> None:
    events = parse_events((finished / EVENTS).read_text(encoding="utf-8"))
    assert [type(event) for event in events if event.iteration == 12] == [Calibration, Pruning, Densification]


def test_held_out_timesteps_keep_their_tracked_parameters(tiny, finished) -> None:
    _, motion = read_model(finished)
    assert motion is not None
    for name in ("expression", "rotation", "neck", "translation"):
        fitted, tracked = getattr(motion, name), getattr(tiny.capture.motion, name)
        assert np.array_equal(fitted[2], tracked[2])
        assert not np.array_equal(fitted[:2], tracked[:2])


def test_training_lowers_the_loss(tiny, tmp_path) -> None:
    losses: list[float] = []
    run = replace(options("default", 150), rates=BASE.rates)
    run = replace(run, schedule=replace(run.schedule, opacity_resets=(), densify_until=0))
    train(tiny.capture, tiny.head, run, tmp_path, lambda p: losses.append(p.values.get("loss", np.nan)))
    # the last report is a running mean; the first is the first iteration's
    monotone = [loss for loss in losses if np.isfinite(loss)]
    assert monotone[-1] < 0.4 * 1.04  # 1.04 is what the untrained ball costs


def test_seeds_differ_and_are_kept(tiny, finished, tmp_path) -> None:
    train(tiny.capture, tiny.head, options(seed=1), tmp_path)
    assert model_bytes(tmp_path) != model_bytes(finished)


def test_another_run_in_the_folder_is_refused_by_the_option_that_differs(tiny, finished) -> None:
    with pytest.raises(OptionError, match=r"seed \(0 and 5\)"):
        train(tiny.capture, tiny.head, options(seed=5), finished)
    with pytest.raises(OptionError, match=r"density\.threshold"):
        train(tiny.capture, tiny.head, replace(options(), density=replace(options().density, threshold=1e-2)), finished)


def test_a_branch_must_come_from_its_own_warm_up(tiny, finished, tmp_path) -> None:
    with pytest.raises(OptionError, match="before 12"):
        train(tiny.capture, tiny.head, options(), tmp_path, start_from=finished / CHECKPOINT)
    with pytest.raises(OptionError, match="seed"):
        train(tiny.capture, tiny.head, options(seed=2), tmp_path, start_from=finished / WARM_UP_CHECKPOINT)
    other = replace(tiny.capture, train=tiny.capture.train[:-1])
    with pytest.raises(OptionError, match="another capture"):
        train(other, tiny.head, options(), tmp_path, start_from=finished / WARM_UP_CHECKPOINT)
    assert not list(tmp_path.iterdir())


def test_another_head_and_cameras_in_one_place_are_refused(tiny, tmp_path) -> None:
    other = replace(tiny.head, name="other", v_template=tiny.head.v_template * 2)
    with pytest.raises(HeadError, match="tracked with head"):
        train(tiny.capture, other, options(), tmp_path)
    single = replace(tiny.capture, train=tiny.capture.train[:1])
    with pytest.raises(DatasetError, match="one place"):
        train(single, tiny.head, options(), tmp_path)


@pytest.mark.parametrize("variant", ["ga", "rad", "rad-gp-lgs", "default-gp-pis", "paper"])
def test_every_variant_runs_and_keeps_its_rules(tiny, tmp_path, variant) -> None:
    model = train(tiny.capture, tiny.head, options(variant, 30), tmp_path)
    prunings = [event for event in model.events if isinstance(event, Pruning)]
    assert bool(prunings) == (variant not in {"ga", "rad"})
    model.gaussians.validate(tiny.head.n_faces)
    if variant in {"ga", "rad", "paper"}:
        assert set(model.gaussians.binding) == set(range(tiny.head.n_faces))
    calibration = next(event for event in model.events if isinstance(event, Calibration))
    assert (len(set(calibration.threshold)) > 1) == (variant in {"rad", "rad-gp-lgs", "paper"})
