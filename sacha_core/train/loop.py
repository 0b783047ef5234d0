"""Training: from a capture to a model folder."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.density.events import Event, write_events
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.scores_file import Scores, write_scores
from sacha_core.errors import DatasetError, HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.interchange.gaussian_avatars import model_iterations
from sacha_core.parallel.pool import Pool
from sacha_core.progress import Progress, Report, silent
from sacha_core.stopwatch import Stopwatch, timed
from sacha_core.train import density_control as control
from sacha_core.train.checkpoint import Checkpoint, differing, read_checkpoint, require_fit, write_checkpoint
from sacha_core.train.cuda.available import missing
from sacha_core.train.densifying import densify
from sacha_core.train.devices import find_device, open_engine
from sacha_core.train.engine import Engine
from sacha_core.train.importance import SeenWeights, importance, look
from sacha_core.train.masks import prune_masked
from sacha_core.train.options import TrainOptions
from sacha_core.train.output import (
    CHECKPOINT,
    EVENTS,
    SCORES,
    WARM_UP_CHECKPOINT,
    TrainedModel,
    discard,
    write_outcome,
    write_plan,
)
from sacha_core.train.pruning import prune, remove_hidden
from sacha_core.train.rates import learning_rates
from sacha_core.train.regions import head_regions
from sacha_core.train.scene import fingerprint, require_poses, scene_extent
from sacha_core.train.state import ROWS, TrainState, initial_state
from sacha_core.train.views import Step, TrainingViews, decoded_ahead, epoch_steps, grouped, spread_views

__all__ = ["REST", "Run", "require_head", "train"]

REST = "rest"  # stage of the stopwatch: of an iteration what is in no other
REPORT_EVERY_S = 0.5
CHANGED = frozenset(ROWS)  # what is void where Gaussians come and go
INITIAL_MASK_LOGIT = 1.0  # Compact-3DGS


def train(
    capture: Capture,
    head: HeadModel,
    options: TrainOptions,
    out: str | os.PathLike[str],
    report: Report = silent,
    resume: bool = True,
    start_from: str | os.PathLike[str] | None = None,
    stopwatch: Stopwatch | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> TrainedModel:
    """Fit an avatar to the training views of a capture.

    On the CPU the same capture, head and options give the same bytes, for any number of threads, interrupted or not.

    A step whose gradient is not finite is not taken, but counted: the model tells of it.

    Args:
        capture: images, cameras and tracked motion.
        head: the head that the motion belongs to.
        options: of the run.
        out: folder that the model goes to; a checkpoint in it is where an interrupted run goes on.
        report: told about progress.
        resume: whether to go on from a checkpoint in `out`; if not, the run begins anew, and what an earlier one left there goes.
        start_from: checkpoint of another run, not beyond its warm-up, to begin with: variants that differ only later share their warm-up.
        stopwatch: told how long each stage of the iterations takes, but for the first; one is named "rest".
        stop: asked after each iteration whether to stop there: a checkpoint is written, so that nothing is lost when the run goes on.

    Returns:
        The model that was written to `out`.

    Raises:
        HeadError: the head is not the capture's, or lacks masks.
        OptionError: `out` holds another run, `start_from` does not lead to this one, or the device cannot be had; the message names the
            option.
        DatasetError: an image cannot be decoded, there is none, the cameras stand in the head, or no Gaussian is left.
        GeometryError: a timestep's tracked pose makes a triangle degenerate.
        FormatError: a checkpoint is damaged.
        OSError: `out` cannot be written.
        KeyboardInterrupt: it was told to stop.
    """
    folder = Path(out)
    require_head(capture, head)
    run = Run(capture, head, options, folder, report, stopwatch, stop)
    run.begin(resume, None if start_from is None else Path(start_from))
    return run.finish()


def require_head(capture: Capture, head: HeadModel) -> None:
    """Refuse a head that the capture was not tracked with.

    Raises:
        HeadError: it names another.
    """
    if capture.head is not None and capture.head.sha256 != head.reference.sha256:
        raise HeadError(
            f"{capture.root} was tracked with head {capture.head.name!r} (SHA-256 {capture.head.sha256[:12]}...),"
            f" not with {head.name!r} ({head.reference.sha256[:12]}...)"
        )


@dataclass
class Run:
    """One run in progress.

    Args:
        capture: see `train`.
        head: see `train`.
        options: see `train`; once the run has begun, `device` says where it computes.
        folder: see `train`.
        report: see `train`.
        stopwatch: see `train`.
        stop: see `train`.
    """

    capture: Capture
    head: HeadModel
    options: TrainOptions
    folder: Path
    report: Report
    stopwatch: Stopwatch | None = None
    stop: Callable[[], bool] = lambda: False
    iteration: int = field(init=False, default=0)
    engine: Engine = field(init=False)
    events: list[Event] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        options, capture = self.options, self.capture
        self.regions = head_regions(self.head, options.scheme)
        self.regions.factors(options.density.region_weights)  # refuses unknown names before anything is done
        size = (options.width, options.height)
        self.extent = scene_extent(capture, self.head)
        self.views = TrainingViews(capture, *size, options.sensitivity_pad, options.image_cache_bytes)
        self.rest_scale = triangle_frames(self.head.v_template, self.head.faces).scale
        self.data = fingerprint(capture, self.head)

    def begin(self, resume: bool, start_from: Path | None) -> None:
        """Take the state from the folder's checkpoint, from another run's, or make it anew."""
        own = self.folder / CHECKPOINT
        goes_on = resume and own.exists()
        if not goes_on and resume and (found := model_iterations(self.folder)):
            raise OptionError(
                f"{self.folder} holds a model of {max(found)} iterations, but not the checkpoint to go on from; "
                "choose another folder, or begin anew"
            )
        source = own if goes_on else start_from
        state = self._fresh() if source is None else self._taken(source, until_warm_up=not goes_on)
        device = find_device(self.options.device)
        self.options = replace(self.options, device=device)
        require_poses(self.capture, self.head)
        self.engine = open_engine(device, self.head, self.capture.motion, self.options)
        if not goes_on:
            discard(self.folder)
        self.iteration = state.iteration
        self.n_gaussians = len(state)
        self.engine.put(state)
        self.targets = decoded_ahead(self.views, self._steps(state.iteration))
        write_plan(self.folder, self.options, self.head.reference)

    def finish(self) -> TrainedModel:
        """Train to the end, and write the model."""
        iterations = self.options.schedule.iterations
        self.advance(iterations)
        state = self._take()
        if self.options.losses.mask > 0:  # the model has no masks
            self.events.append(prune_masked(state, self.regions))
            self._require_some(state)
            self.engine.put(state)
        if self.options.pruning.hidden_at_end:
            seen = self._look(self._degree())
            self.events.append(remove_hidden(state, self.options, self.regions, seen)[0])
            self._require_some(state)
        fitted = state.motion(self.capture.motion)
        outcome = (state.gaussians(), fitted, tuple(self.events), state.faults, self.options.device)
        model = TrainedModel(self.folder, iterations, *outcome)
        write_outcome(model)
        return model

    def advance(self, end: int) -> None:
        """Train until so many iterations are done; once for each run that began."""
        if self.iteration < end:
            self.views.preload(Pool(self.options.threads), self.report)
        begun_s = told_s = time.monotonic()
        first = self.iteration
        values: dict[str, float] = {}
        with closing(self.targets):
            while self.iteration < end:
                watch = self.engine.stopwatch = self.stopwatch if self.iteration > first else None  # the first compiles
                with timed(watch, REST):
                    self.iterate()
                    self._save()
                    now_s, done = time.monotonic(), self.iteration
                    if now_s - told_s >= REPORT_EVERY_S or done == end:
                        told_s = now_s
                        if losses := self.engine.losses():  # may wait for a device: iterations take that time, too
                            values["loss"] = losses["total"]
                        values["gaussians"] = float(self.n_gaussians)
                        values["iterations_per_s"] = (done - first) / max(now_s - begun_s, 1e-9)
                        self.report(Progress("train", done, end, dict(values)))
                if done < end and self.stop():
                    self._checkpoint(CHECKPOINT)
                    raise KeyboardInterrupt

    def iterate(self) -> None:
        """Do one iteration."""
        options = self.options
        with timed(self.engine.stopwatch, "wait for images"):
            targets = next(self.targets)
        self.iteration += 1
        degree = self._degree()
        self.engine.differentiate(self.iteration, targets, degree)
        with timed(self.engine.stopwatch, "density control"):
            void = self._control_density(degree)
        self.engine.advance(learning_rates(options.rates, options.schedule, self.iteration, self.extent), void)

    def _degree(self) -> int:
        """Give the degree of the harmonics in use."""
        return min(self.options.sh_degree, self.iteration // self.options.schedule.sh_every)

    def _control_density(self, degree: int) -> frozenset[str]:
        """Do what is due after this iteration, in the method's order; give the attributes whose gradients are void by it."""
        schedule, now = self.options.schedule, self.iteration
        last = now >= schedule.iterations
        calibrates, resets = now in schedule.calibrations and not last, now in schedule.opacity_resets and not last
        judges = calibrates or (schedule.prunes(now) and not last)
        masked = self.options.losses.mask > 0 and schedule.prunes_masked(now) and not last
        void: frozenset[str] = frozenset()
        if not (judges or resets or masked or schedule.densifies(now)):
            return void
        state = self._take()
        if judges:
            void |= self._judge(state, degree, calibrates)
        if masked:
            self.events.append(prune_masked(state, self.regions))
            void |= CHANGED
        if schedule.densifies(now):
            scale = self.engine.triangle_scale
            self.events.append(densify(state, self.options, self.regions, scale, self.extent))
            void |= CHANGED
        if resets:
            self.events.append(control.reset_opacity(state, self.options))
            void |= {"opacity_logit"}
        write_events(self.folder / EVENTS, self.events)
        self._require_some(state)
        self.engine.put(state)
        self.n_gaussians = len(state)
        return void

    def _require_some(self, state: TrainState) -> None:
        if not len(state):
            raise DatasetError(
                f"no Gaussian is left after iteration {state.iteration}: none was opaque, small or visible enough"
                f" (extent {self.extent:.3g} m); are the images all background, or the cameras inside the head?"
            )

    def _judge(self, state: TrainState, degree: int, calibrates: bool) -> frozenset[str]:
        """Measure the regions, score and prune, where that is due; keep the scores of the last time; give what is void by it."""
        options, schedule, now = self.options, self.options.schedule, self.iteration
        is_last = now == (schedule.last_pruning or max(schedule.calibrations, default=0))
        by_score = options.pruning.scope != "none" and schedule.prunes(now)
        hidden_first = options.pruning.hidden_first and schedule.prunes(now)
        scores = by_score or is_last
        seen = None
        if scores or hidden_first or options.density.means != "plain":
            seen = self._look(degree, KNOWN_SCORES[options.pruning.score].passes if scores else ())
        if calibrates:
            self.events.append(control.calibrate(state, options, self.regions, seen))
        if seen is None:
            return frozenset()
        score = importance(state, options, seen, self.rest_scale) if scores else np.zeros(len(state))
        facts = (self.head.n_faces, options.scheme)
        before = Scores(state.gaussians(), score, *facts, sums=seen.sums()) if is_last else None
        if hidden_first:
            event, kept = remove_hidden(state, options, self.regions, seen)
            self.events.append(event)
            score = score[kept]
        if by_score:
            self.events.append(prune(state, options, self.regions, score))
        if before is not None:
            write_scores(self.folder / SCORES, replace(before, events=tuple(self.events)))
        return CHANGED if by_score or hidden_first else frozenset()

    def _look(self, degree: int, passes: Sequence[str] = ()) -> SeenWeights:
        """Sum over training views what they show of each Gaussian; each timestep is posed once."""
        wanted = self.options.importance.views or len(self.views.views)
        chosen = spread_views(self.views.views, wanted)
        steps = decoded_ahead(self.views, grouped(self.views.views, chosen, len(chosen)))
        return look(self.engine, steps, len(chosen), degree, passes, self.report)

    def _steps(self, iteration: int) -> Iterator[Step]:
        """Give the views that each iteration learns from, beginning after `iteration`."""
        views, options = self.views.views, self.options
        in_all = len(epoch_steps(views, options.cameras_per_step, options.seed, 0))  # in every epoch
        while True:
            epoch, done = divmod(iteration, in_all)
            yield from epoch_steps(views, options.cameras_per_step, options.seed, epoch)[done:]
            iteration += in_all - done

    def _take(self) -> TrainState:
        """Give the state as it is now."""
        state = self.engine.take()
        state.iteration = self.iteration
        return state

    def _save(self) -> None:
        """Write a checkpoint where one is due."""
        schedule, done = self.options.schedule, self.iteration
        due = {
            # before the first calibration: variants part in the iteration after this one
            WARM_UP_CHECKPOINT: done == schedule.warm_up - 1,
            CHECKPOINT: done % self.options.checkpoint_every == 0 or done == schedule.iterations,
        }
        for name in (name for name, is_due in due.items() if is_due):
            with timed(self.engine.stopwatch, "checkpoint"):
                self._checkpoint(name)

    def _checkpoint(self, name: str) -> None:
        """Write all that the run needs to go on from here."""
        checkpoint = Checkpoint(self._take(), self.options, tuple(self.events), self.data)
        write_checkpoint(self.folder / name, checkpoint)

    def _fresh(self) -> TrainState:
        """Give the state before the first iteration."""
        rng = np.random.default_rng([self.options.seed, 0])
        gaussians = initial_gaussians(self.head.n_faces, rng, self.options.sh_degree)
        density = self.options.density
        bases = (density.threshold_in_warm_up or density.threshold, self.options.pruning.ratio)
        mask_logit = INITIAL_MASK_LOGIT if self.options.losses.mask > 0 else None
        return initial_state(gaussians, self.capture.motion, self.regions.n_regions, *bases, mask_logit)

    def _taken(self, path: Path, until_warm_up: bool) -> TrainState:
        """Give the state to go on from, if a checkpoint leads to this run; take over its events, and its device where none is asked for."""
        checkpoint = read_checkpoint(path)
        if checkpoint.data != self.data:
            raise OptionError(f"{path} is of a run with another capture or head; choose another folder, or begin anew")
        if difference := differing(checkpoint.options, self.options, until_warm_up):
            raise OptionError(f"{path} is of a run with another {difference}; choose another folder, or begin anew")
        if until_warm_up and checkpoint.state.iteration >= self.options.schedule.warm_up:
            end = self.options.schedule.warm_up
            raise OptionError(
                f"{path} is at iteration {checkpoint.state.iteration}, expected one before {end}, where warm-up ends"
            )
        if self.options.device == "auto":
            self._stay_on(checkpoint.options.device, path)
        fresh, state = self._fresh(), checkpoint.state
        require_fit(path, state, fresh, self.head.n_faces)
        self.events = list(checkpoint.events)
        return replace(state, thresholds=fresh.thresholds, ratios=fresh.ratios) if until_warm_up else state

    def _stay_on(self, device: Literal["auto", "cpu", "cuda"], path: Path) -> None:
        """Let a run for which no device is asked go on where it was: elsewhere its numbers would be others."""
        if device == "cuda" and (lack := missing()) is not None:
            raise OptionError(f"{path} is of a run on cuda, but {lack}; choose the device cpu if it shall go on there")
        self.options = replace(self.options, device=device)
