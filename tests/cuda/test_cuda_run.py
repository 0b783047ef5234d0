"""Whole runs by the CUDA engine on the CPU, drawn by the stand-in: every event of density control, and going on where it stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gsplat_stand_in
import numpy as np
import pytest
from PIL import Image

from sacha_core.density.events import Calibration, Densification, OpacityReset, Pruning, parse_events
from sacha_core.interchange.capture import Capture, View
from sacha_core.train import loop
from sacha_core.train.checkpoint import read_checkpoint
from sacha_core.train.cuda.engine import CudaEngine
from sacha_core.train.loop import train
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import CHECKPOINT, EVENTS
from sacha_core.train.presets import scaled

ITERATIONS = 40
COUNT = 0.03  # relative: how many Gaussians there are at the end, where each threshold's last digits decide
LOSS = 0.05  # relative, of the last iterations


@pytest.fixture(scope="module")
def capture(stage, tmp_path_factory) -> Capture:
    """Give a capture of the views."""
    root: Path = tmp_path_factory.mktemp("capture")
    views = []
    for place, target in enumerate(stage.targets):
        path = root / f"{place}.png"
        Image.fromarray(target.image.transpose(1, 2, 0)).save(path)
        views.append(View(target.timestep, place, target.camera, path, None))
    return Capture(root, stage.head.reference, None, stage.motion, tuple(views), (), ())


def options(**changes) -> TrainOptions:
    """Give a short run with every kind of event."""
    made = scaled(ITERATIONS, "sacha", TrainOptions(threads=1, sh_degree=2, device="cpu", **changes))
    warm_up = made.schedule.warm_up
    schedule = replace(made.schedule, calibrations=(warm_up, 2 * warm_up), densify_every=4, densify_from=3, sh_every=8)
    density = replace(made.density, threshold=2e-3, threshold_lowest=1e-3, threshold_highest=4e-3)
    return replace(made, schedule=schedule, density=density)


@pytest.fixture
def on_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs compute by the CUDA engine."""

    def open_engine(_, head, motion, options):
        return CudaEngine(head, motion, options, "cpu", gsplat_stand_in)

    monkeypatch.setattr(loop, "open_engine", open_engine)


def losses_of(capture, head, folder: Path, **changes) -> list[float]:
    """Train, and give the losses that were reported."""
    told: list[float] = []
    train(capture, head, options(**changes), folder, lambda progress: told.append(progress.values.get("loss", np.nan)))
    return told


@pytest.mark.parametrize("cameras", [1, 3])
def test_a_run_goes_as_the_cpu_goes(stage, capture, tmp_path, request, monkeypatch, cameras) -> None:
    monkeypatch.setattr(loop, "REPORT_EVERY_S", 0.0)
    ends = []
    for place in ("cpu", "device"):
        if place == "device":
            request.getfixturevalue("on_device")
        told = losses_of(capture, stage.head, tmp_path / place, cameras_per_step=cameras)
        found = read_checkpoint(tmp_path / place / CHECKPOINT)
        events = parse_events((tmp_path / place / EVENTS).read_text())
        ends.append((len(found.state), np.mean(told[-10:]), [type(event) for event in events], found.state))
    (count, loss, kinds, state), (count_, loss_, kinds_, state_) = ends
    assert kinds == kinds_
    assert set(kinds) == {Calibration, Densification, OpacityReset, Pruning}
    assert count_ == pytest.approx(count, rel=COUNT)
    assert loss_ == pytest.approx(loss, rel=LOSS)
    assert state_.steps == state.steps
    assert state_.faults == state.faults


def test_a_run_that_was_interrupted_ends_as_the_other(stage, capture, tmp_path, on_device, monkeypatch) -> None:
    class InterruptionError(Exception):
        pass

    def report(progress) -> None:
        if progress.stage == "train" and progress.done >= 27:
            raise InterruptionError

    monkeypatch.setattr(loop, "REPORT_EVERY_S", 0.0)
    train(capture, stage.head, options(), tmp_path / "one")
    with pytest.raises(InterruptionError):
        train(capture, stage.head, options(checkpoint_every=20), tmp_path / "two", report)
    train(capture, stage.head, options(checkpoint_every=7), tmp_path / "two")
    one, two = (read_checkpoint(tmp_path / name / CHECKPOINT).state for name in ("one", "two"))
    for kind in ("values", "first", "second"):
        for name, array in getattr(one, kind).items():
            assert np.array_equal(getattr(two, kind)[name], array), (kind, name)
    assert np.array_equal(one.gradient_sum, two.gradient_sum)
    assert one.steps == two.steps
