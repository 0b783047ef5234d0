"""Whole runs on the tiny capture: they learn, resume to the bit, branch, and refuse what does not belong to them."""

from __future__ import annotations

import errno
import itertools
import json
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.density.events import Calibration, Densification, HiddenRemoval, OpacityReset, Pruning, parse_events
from sacha_core.density.scores_file import read_scores
from sacha_core.errors import GeometryError, HeadError, OptionError
from sacha_core.interchange.gaussian_avatars import read_model
from sacha_core.progress import silent
from sacha_core.stopwatch import Stopwatch
from sacha_core.train.checkpoint import read_checkpoint
from sacha_core.train.loop import Run, train
from sacha_core.train.options import TrainOptions, from_record
from sacha_core.train.output import CHECKPOINT, EVENTS, SCORES, WARM_UP_CHECKPOINT
from sacha_core.train.presets import scaled
from sacha_core.train.state import ATTRIBUTES

ITERATIONS = 40
SOME_HIDDEN = 5.0  # pixels a view, which some of these few triangles reach and others not
BASE = TrainOptions(threads=1, sh_degree=1, device="cpu")


def options(variant: str = "sacha", iterations: int = ITERATIONS, **changes) -> TrainOptions:
    """Give a short run with every kind of event: two calibrations, densifications, resets."""
    made = scaled(iterations, variant, replace(BASE, **changes))
    warm_up = made.schedule.warm_up
    end = {"densify_until": 2 * warm_up} if variant == "sacha" else {}
    schedule = replace(made.schedule, calibrations=(warm_up, 2 * warm_up), densify_every=4, densify_from=3, **end)
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


def test_a_run_that_is_told_to_stop_loses_nothing(tiny, finished, tmp_path) -> None:
    """Oracle: the run that nobody stopped, to the byte; what is left is a checkpoint of the very iteration at which it was told."""
    asked = iter([False] * 8 + [True])
    with pytest.raises(KeyboardInterrupt):
        train(tiny.capture, tiny.head, options(), tmp_path, stop=lambda: next(asked))
    assert read_checkpoint(tmp_path / CHECKPOINT).state.iteration == 9
    train(tiny.capture, tiny.head, options(), tmp_path)
    assert model_bytes(tmp_path) == model_bytes(finished)


@pytest.fixture(scope="module")
def checkpoints(tiny, tmp_path_factory) -> dict[int, Path]:
    """Give a folder for every iteration, as a run leaves it that is interrupted right after its checkpoint of that iteration."""
    running, kept = tmp_path_factory.mktemp("running"), tmp_path_factory.mktemp("kept")
    folders: dict[int, Path] = {}

    def keep(progress) -> None:
        if (
            progress.stage == "train" and progress.done > 1
        ):  # told before the checkpoint of its own iteration is written
            folders[progress.done - 1] = Path(shutil.copytree(running, kept / str(progress.done - 1)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
        train(tiny.capture, tiny.head, replace(options(), checkpoint_every=1), running, keep)
    return folders


# around the densification of 4, the reset of 7, both calibrations and the end; views are shown in epochs of 12
@pytest.mark.parametrize("iteration", [1, 3, 4, 6, 7, 11, 12, 13, 23, 24, 25, 39])
def test_a_run_resumes_to_the_bit_from_any_iteration(tiny, finished, checkpoints, iteration) -> None:
    train(tiny.capture, tiny.head, options(), checkpoints[iteration])
    assert model_bytes(checkpoints[iteration]) == model_bytes(finished)


def test_a_disk_that_fills_up_costs_the_checkpoint_and_nothing_else(tiny, finished, tmp_path, monkeypatch) -> None:
    often = replace(options(), checkpoint_every=10)
    write, written = np.lib.format.write_array, []

    def full_after_a_while(stream, array, **rest) -> None:
        written.append(array)
        if len(written) == 60:  # in the midst of the second checkpoint, that at the end of warm-up
            stream.write(b"half of it")
            raise OSError(errno.ENOSPC, "No space left on device")
        write(stream, array, **rest)

    with monkeypatch.context() as patch:
        patch.setattr(np.lib.format, "write_array", full_after_a_while)
        with pytest.raises(OSError, match=rf"No space left.*{WARM_UP_CHECKPOINT}"):
            train(tiny.capture, tiny.head, often, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} <= {"options.json", "head.json", EVENTS, CHECKPOINT, WARM_UP_CHECKPOINT}
    assert read_checkpoint(tmp_path / CHECKPOINT).state.iteration == 10
    train(tiny.capture, tiny.head, often, tmp_path)
    assert model_bytes(tmp_path) == model_bytes(finished)


def test_beginning_anew_leaves_nothing_of_the_earlier_run(tiny, finished, tmp_path) -> None:
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    shorter = options(iterations=30)
    with pytest.raises(OptionError, match="another schedule"):
        train(tiny.capture, tiny.head, shorter, tmp_path)
    model = train(tiny.capture, tiny.head, shorter, tmp_path, resume=False)
    assert [path.name for path in (tmp_path / "point_cloud").iterdir()] == ["iteration_30"]
    assert np.array_equal(read_model(tmp_path)[0].position, model.gaussians.position)
    train(tiny.capture, tiny.head, shorter, tmp_path / "alone")
    alone = model_bytes(tmp_path / "alone")
    assert {name: data for name, data in model_bytes(tmp_path).items() if not name.startswith("alone")} == alone


def test_a_model_without_its_checkpoint_is_not_written_over(tiny, finished, tmp_path) -> None:
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    (tmp_path / CHECKPOINT).unlink()
    with pytest.raises(OptionError, match="a model of 40 iterations, but not the checkpoint"):
        train(tiny.capture, tiny.head, options(iterations=30), tmp_path)
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
    assert scores.events == tuple(event for event in events if event.iteration < 24) + tuple(
        event for event in events if event.iteration == 24 and isinstance(event, Calibration | Pruning)
    )


def test_default_seen_is_default_without_what_never_shows(tiny, tmp_path) -> None:
    """The oracle is the default run itself, and an importance pass over it."""
    importance = replace(options().importance, visible_pixels=SOME_HIDDEN)
    default, default_seen = (replace(options(name), importance=importance) for name in ("default", "default-seen"))
    plain = train(tiny.capture, tiny.head, default, tmp_path / "default")
    seen = train(tiny.capture, tiny.head, default_seen, tmp_path / "seen")
    *before, last = seen.events
    assert tuple(before) == plain.events
    assert isinstance(last, HiddenRemoval)
    assert last.iteration == ITERATIONS
    assert 0 < sum(last.removed) == sum(last.requested) < sum(last.before) == len(plain.gaussians)
    run = Run(tiny.capture, tiny.head, default, tmp_path / "default", silent)
    run.begin(resume=True, start_from=None)
    shows = run._look(1).sums().visible(importance.visible_pixels)
    for name in ATTRIBUTES:
        assert np.array_equal(getattr(seen.gaussians, name), getattr(plain.gaussians, name)[shows])
    again = model_bytes(tmp_path / "seen")
    train(tiny.capture, tiny.head, default_seen, tmp_path / "seen")
    assert model_bytes(tmp_path / "seen") == again


def test_what_never_shows_goes_first_where_that_is_asked_for(tiny, tmp_path) -> None:
    made = options()
    made = replace(made, pruning=replace(made.pruning, hidden_first=True))
    events = train(tiny.capture, tiny.head, made, tmp_path).events
    pairs = [(a, b) for a, b in itertools.pairwise(events) if isinstance(a, HiddenRemoval)]
    assert len(pairs) == 2
    for hidden, pruned in pairs:
        assert isinstance(pruned, Pruning)
        assert hidden.iteration == pruned.iteration
        assert hidden.removed == hidden.requested
        assert hidden.after == pruned.before
        assert sum(pruned.removed) == int(made.pruning.ratio * sum(pruned.before))


def test_calibration_pruning_densification_and_reset_come_in_this_order(tiny, tmp_path) -> None:
    made = options()
    made = replace(made, schedule=replace(made.schedule, opacity_resets=(12,)))
    events = train(tiny.capture, tiny.head, made, tmp_path).events
    kinds = [type(event) for event in events if event.iteration == 12]
    assert kinds == [Calibration, Pruning, Densification, OpacityReset]
    pruned, grown = (event for event in events if event.iteration == 12 and isinstance(event, Pruning | Densification))
    assert pruned.after == grown.before


def test_held_out_timesteps_keep_their_tracked_parameters(tiny, finished) -> None:
    _, motion = read_model(finished)
    assert motion is not None
    for name in ("expression", "rotation", "neck", "translation"):
        fitted, tracked = getattr(motion, name), getattr(tiny.capture.motion, name)
        assert np.array_equal(fitted[2], tracked[2])
        assert not np.array_equal(fitted[:2], tracked[:2])


def test_training_lowers_the_loss(tiny, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
    losses: list[float] = []
    run = replace(options("default", 150), rates=BASE.rates)
    run = replace(run, schedule=replace(run.schedule, opacity_resets=(), densify_until=0))
    train(tiny.capture, tiny.head, run, tmp_path, lambda p: losses.append(p.values.get("loss", np.nan)))
    losses = [loss for loss in losses if np.isfinite(loss)]
    assert np.mean(losses[-12:]) < 0.4 * np.mean(losses[:1])


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
    first, *others = tiny.capture.train
    larger = tmp_path.with_name("larger.png")
    larger.write_bytes(first.image_path.read_bytes() + b"\0")
    aside = replace(first, camera=replace(first.camera, cx=first.camera.cx + 0.5))
    for changed in (replace(first, image_path=larger), aside):
        other = replace(tiny.capture, train=(changed, *others))
        with pytest.raises(OptionError, match="another capture"):
            train(other, tiny.head, options(), tmp_path, start_from=finished / WARM_UP_CHECKPOINT)
    moved = replace(tiny.capture.motion, static_offset=np.full((tiny.head.n_vertices, 3), 1e-4, np.float32))
    with pytest.raises(OptionError, match="another capture"):
        train(
            replace(tiny.capture, motion=moved),
            tiny.head,
            options(),
            tmp_path,
            start_from=finished / WARM_UP_CHECKPOINT,
        )
    assert not list(tmp_path.iterdir())


def test_another_head_is_refused(tiny, tmp_path) -> None:
    other = replace(tiny.head, name="other", v_template=tiny.head.v_template * 2)
    with pytest.raises(HeadError, match="tracked with head"):
        train(tiny.capture, other, options(), tmp_path)


def test_a_pose_that_flattens_a_triangle_is_named_by_its_timestep(tiny, tmp_path) -> None:
    to_a_point = tiny.head.exprdirs.copy()
    to_a_point[:, :, 0] = -tiny.head.v_template
    head = replace(tiny.head, exprdirs=to_a_point)
    expression = tiny.capture.motion.expression.copy()
    expression[1, 0] = 1
    capture = replace(tiny.capture, head=head.reference, motion=replace(tiny.capture.motion, expression=expression))
    with pytest.raises(GeometryError, match="timestep 1: triangle 0"):
        train(capture, head, options(), tmp_path)


def test_a_head_without_masks_is_refused(tiny, tmp_path) -> None:
    with pytest.raises(HeadError, match="no vertex mask"):
        train(tiny.capture, replace(tiny.head, masks={}), options(), tmp_path)


def test_cameras_that_see_nothing_teach_nothing(tiny, tmp_path) -> None:
    about = np.array([1, -1, -1])
    views = tuple(
        replace(
            view,
            camera=replace(
                view.camera, rotation=view.camera.rotation * about[:, None], translation=view.camera.translation * about
            ),
        )
        for view in tiny.capture.train
    )
    model = train(replace(tiny.capture, train=views), tiny.head, options("default"), tmp_path)
    assert not model.gaussians.position.any()
    assert np.array_equal(model.motion.expression, tiny.capture.motion.expression)
    assert all(event.visible_counts == (0,) * 8 for event in model.events if isinstance(event, Calibration))


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


def test_stages_make_up_the_time_of_all_iterations_but_the_first(tiny, tmp_path) -> None:
    watch = Stopwatch()
    start = time.perf_counter()
    train(tiny.capture, tiny.head, options(iterations=30), tmp_path, stopwatch=watch)
    whole = time.perf_counter() - start
    assert watch.counts["rest"] == watch.counts["loss"] == 29
    assert watch.counts["Adam"] > 29  # once more at the end at least, where the last step is taken for itself
    assert watch.counts["density control"] == 29
    assert sum(watch.seconds.values()) < whole
    assert all(seconds >= 0 for seconds in watch.seconds.values())


def test_several_cameras_a_step_resume_to_the_bit_whatever_the_threads(tiny, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("sacha_core.train.loop.REPORT_EVERY_S", 0.0)
    several = replace(options(iterations=30), cameras_per_step=4, checkpoint_every=7)
    train(tiny.capture, tiny.head, several, tmp_path / "whole")
    with pytest.raises(InterruptedTrainingError):
        train(tiny.capture, tiny.head, replace(several, threads=3), tmp_path / "parts", interrupt_after(17))
    train(tiny.capture, tiny.head, replace(several, threads=2), tmp_path / "parts")
    assert model_bytes(tmp_path / "parts") == model_bytes(tmp_path / "whole")
