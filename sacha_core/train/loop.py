"""Training: from a capture to a model folder."""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.density.events import Event, write_events
from sacha_core.density.scores_file import Scores, write_scores
from sacha_core.errors import DatasetError, HeadError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.interchange.gaussian_avatars import model_iterations
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.pool import Pool
from sacha_core.train import density_control as control
from sacha_core.train.checkpoint import Checkpoint, differing, read_checkpoint, require_fit, write_checkpoint
from sacha_core.train.optimiser import adam, position_rate
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
from sacha_core.train.regions import head_regions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState, initial_state
from sacha_core.train.step import Drawing, Outcome, Stage
from sacha_core.train.threads import one_torch_thread
from sacha_core.train.views import TrainingViews, epoch_order, spread_views

__all__ = ["train"]

REPORT_EVERY_S = 0.5
SMOOTHING = 0.98  # of the loss that is shown


def train(
    capture: Capture,
    head: HeadModel,
    options: TrainOptions,
    out: str | os.PathLike[str],
    report: Report = silent,
    resume: bool = True,
    start_from: str | os.PathLike[str] | None = None,
) -> TrainedModel:
    """Fit an avatar to the training views of a capture.

    The same capture, head and options give the same bytes, for any number of threads, interrupted or not.

    Args:
        capture: images, cameras and tracked motion.
        head: the head that the motion belongs to.
        options: of the run.
        out: folder that the model goes to; a checkpoint in it is where an interrupted run goes on.
        report: told about progress.
        resume: whether to go on from a checkpoint in `out`; if not, the run begins anew, and what an earlier one left there goes.
        start_from: checkpoint of another run, not beyond its warm-up, to begin with: variants that differ only later share their warm-up.

    Returns:
        The model that was written to `out`.

    Raises:
        HeadError: the head is not the capture's, or lacks masks.
        OptionError: `out` holds another run, or `start_from` does not lead to this one; the message names the option.
        DatasetError: an image cannot be decoded, or the cameras stand in one place.
        GeometryError: a timestep's pose makes a triangle degenerate.
        FormatError: a checkpoint is damaged.
        OSError: `out` cannot be written.
    """
    folder = Path(out)
    if capture.head is not None and capture.head.sha256 != head.reference.sha256:
        raise HeadError(
            f"{capture.root} was tracked with head {capture.head.name!r} (SHA-256 {capture.head.sha256[:12]}...),"
            f" not with {head.name!r} ({head.reference.sha256[:12]}...)"
        )
    with one_torch_thread():
        run = Run(capture, head, options, folder, report)
        run.begin(resume, None if start_from is None else Path(start_from))
        return run.finish()


@dataclass
class Run:
    """One run in progress.

    Args:
        capture: see `train`.
        head: see `train`.
        options: see `train`.
        folder: see `train`.
        report: see `train`.
    """

    capture: Capture
    head: HeadModel
    options: TrainOptions
    folder: Path
    report: Report
    state: TrainState = field(init=False)
    events: list[Event] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        options, capture = self.options, self.capture
        self.pool = Pool(options.threads)
        self.regions = head_regions(self.head, options.scheme)
        size = (options.width, options.height)
        self.views = TrainingViews(capture, *size, options.sensitivity_pad, options.image_cache_bytes)
        self.stage = Stage(self.head, capture.motion, options.losses, self.pool, options.fine_tune)
        self.extent = scene_extent(capture)
        self.rest_scale = triangle_frames(self.head.v_template, self.head.faces).scale
        self.data = fingerprint(capture, self.head)
        self.order, self.epoch = np.empty(0, int), -1

    def begin(self, resume: bool, start_from: Path | None) -> None:
        """Take the state from the folder's checkpoint, from another run's, or make it anew."""
        own = self.folder / CHECKPOINT
        if resume and own.exists():
            self._take(read_checkpoint(own), own, until_warm_up=False)
        else:
            if resume and (found := model_iterations(self.folder)):
                raise OptionError(
                    f"{self.folder} holds a model of {max(found)} iterations, but not the checkpoint to go on from; "
                    "choose another folder, or begin anew"
                )
            if start_from is not None:
                self._take(read_checkpoint(start_from), start_from, until_warm_up=True)
            else:
                self.state = self._fresh()
            discard(self.folder)
        write_plan(self.folder, self.options, self.head.reference)

    def finish(self) -> TrainedModel:
        """Train to the end, and write the model."""
        iterations = self.options.schedule.iterations
        if self.state.iteration < iterations:
            self.views.preload(self.pool, self.report)
        begun_s = told_s = time.monotonic()
        first, shown = self.state.iteration, None
        while self.state.iteration < iterations:
            losses = self.iterate()
            shown = losses["total"] if shown is None else SMOOTHING * shown + (1 - SMOOTHING) * losses["total"]
            now_s, done = time.monotonic(), self.state.iteration
            if now_s - told_s >= REPORT_EVERY_S or done == iterations:
                told_s = now_s
                speed = (done - first) / max(now_s - begun_s, 1e-9)
                values = {"loss": shown, "gaussians": float(len(self.state)), "iterations_per_s": speed}
                self.report(Progress("train", done, iterations, values))
            self._save()
        fitted = self.state.motion(self.capture.motion)
        model = TrainedModel(self.folder, iterations, self.state.gaussians(), fitted, tuple(self.events))
        write_outcome(model)
        return model

    def iterate(self) -> dict[str, float]:
        """Do one iteration, and give its losses."""
        state, options = self.state, self.options
        target = self.views[self._view(state.iteration)]
        state.iteration += 1
        degree = min(options.sh_degree, state.iteration // options.schedule.sh_every)
        drawing = self.stage.draw(state, target.timestep, target.camera, degree, target.box)
        outcome = self.stage.judge(state, drawing, target, degree)
        state.gradient_sum[outcome.visible] += outcome.image_gradient[outcome.visible]
        state.gradient_count += outcome.visible
        untouched = self._control_density(drawing, degree)
        self._step(outcome, untouched)
        return outcome.losses

    def _control_density(self, drawing: Drawing, degree: int) -> frozenset[str]:
        """Do what is due after this iteration, in the method's order; give the attributes whose gradients are void by it."""
        state, schedule, last = self.state, self.options.schedule, self.options.schedule.iterations
        done = len(self.events)
        void: frozenset[str] = frozenset()
        if state.iteration in schedule.calibrations and state.iteration < last:
            void |= self._calibrate(degree)
        if schedule.densifies(state.iteration):
            scale = drawing.triangle_scale
            self.events.append(control.densify(state, self.options, self.regions, scale, self.extent))
            void |= frozenset(ATTRIBUTES)
        if state.iteration in schedule.opacity_resets and state.iteration < last:
            self.events.append(control.reset_opacity(state, self.options))
            void |= {"opacity_logit"}
        if len(self.events) > done:
            write_events(self.folder / EVENTS, self.events)
        return void

    def _calibrate(self, degree: int) -> frozenset[str]:
        """Measure the regions; score and prune where the variant does; keep the scores of the last time."""
        state, options = self.state, self.options
        prunes = options.pruning.scope != "none"
        is_last = state.iteration == max(options.schedule.calibrations)
        seen = self._look(degree) if prunes or is_last or options.density.means != "plain" else None
        self.events.append(control.calibrate(state, options, self.regions, seen))
        if seen is None:
            return frozenset()
        score, before = control.importance(state, options, seen, self.rest_scale), state.gaussians()
        if prunes:
            self.events.append(control.prune(state, options, self.regions, score))
        if is_last:
            facts = (self.head.n_faces, options.scheme, tuple(self.events))
            write_scores(self.folder / SCORES, Scores(before, score, *facts))
        return frozenset(ATTRIBUTES) if prunes else frozenset()

    def _look(self, degree: int) -> control.SeenWeights:
        """Sum blending weights over training views, in float64."""
        chosen = spread_views(self.views.views, self.options.importance.views)
        weights = np.zeros((len(self.state), 2))
        for done, index in enumerate(chosen, 1):
            weights += self.stage.weights(self.state, self.views[index], degree)
            self.report(Progress("measure importance", done, len(chosen)))
        return control.SeenWeights(weights, len(chosen))

    def _step(self, outcome: Outcome, untouched: frozenset[str]) -> None:
        """Let Adam step; attributes whose rows have changed since their gradient was made wait for the next iteration."""
        rates, schedule, state = self.options.rates, self.options.schedule, self.state
        decayed = position_rate(rates.position, rates.position_last, state.iteration, schedule.position_decay)
        by_name = {
            "position": decayed * self.extent,
            **{name: getattr(rates, name) for name in ATTRIBUTES if name != "position"},
            **dict.fromkeys(("rotation", "neck", "jaw", "eyes"), rates.pose),
            "translation": rates.translation,
            "expression": rates.expression,
        }
        gradients = {name: value for name, value in outcome.gradients.items() if name not in untouched}
        if gradients:
            adam(state, "gaussians", gradients, by_name, self.pool)
        if outcome.motion_gradients:
            adam(state, "motion", outcome.motion_gradients, by_name, self.pool)

    def _view(self, iteration: int) -> int:
        """Give the index of the view that an iteration learns from."""
        epoch, place = divmod(iteration, len(self.views))
        if epoch != self.epoch:
            self.order, self.epoch = epoch_order(len(self.views), self.options.seed, epoch), epoch
        return int(self.order[place])

    def _save(self) -> None:
        """Write a checkpoint where one is due."""
        schedule, done = self.options.schedule, self.state.iteration
        checkpoint = Checkpoint(self.state, self.options, tuple(self.events), self.data)
        if done == schedule.warm_up - 1:  # before the first calibration: variants part in the iteration after this one
            write_checkpoint(self.folder / WARM_UP_CHECKPOINT, checkpoint)
        if done % self.options.checkpoint_every == 0 or done == schedule.iterations:
            write_checkpoint(self.folder / CHECKPOINT, checkpoint)

    def _fresh(self) -> TrainState:
        """Give the state before the first iteration."""
        rng = np.random.default_rng([self.options.seed, 0])
        gaussians = initial_gaussians(self.head.n_faces, rng, self.options.sh_degree)
        bases = (self.options.density.threshold, self.options.pruning.ratio)
        return initial_state(gaussians, self.capture.motion, self.regions.n_regions, *bases)

    def _take(self, checkpoint: Checkpoint, path: Path, until_warm_up: bool) -> None:
        """Go on from a checkpoint, if it leads to this run."""
        if checkpoint.data != self.data:
            raise OptionError(f"{path} is of a run with another capture or head; choose another folder, or begin anew")
        if difference := differing(checkpoint.options, self.options, until_warm_up):
            raise OptionError(f"{path} is of a run with another {difference}; choose another folder, or begin anew")
        if until_warm_up and checkpoint.state.iteration >= self.options.schedule.warm_up:
            end = self.options.schedule.warm_up
            raise OptionError(
                f"{path} is at iteration {checkpoint.state.iteration}, expected one before {end}, where warm-up ends"
            )
        fresh = self._fresh()
        require_fit(path, checkpoint.state, fresh, self.head.n_faces)
        self.state, self.events = checkpoint.state, list(checkpoint.events)
        if until_warm_up:
            self.state = replace(self.state, thresholds=fresh.thresholds, ratios=fresh.ratios)


def scene_extent(capture: Capture) -> float:
    """Give 1.1 times the farthest that a training frame's camera stands from the middle of all, metres.

    Source: GaussianAvatars' and 3DGS's scene normalisation.
    """
    centres = np.array([view.camera.centre for view in capture.train], np.float64)
    extent = 1.1 * float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    if not extent > 0:
        raise DatasetError(f"{capture.root}: all training cameras stand in one place; expected several viewpoints")
    return extent


def fingerprint(capture: Capture, head: HeadModel) -> dict[str, Any]:
    """Give what must be the same for a run to go on; images are told by their sizes on disk.

    Raises:
        OSError: an image is not there.
    """
    motion, digest = capture.motion, hashlib.sha256()
    for name in ("shape", "static_offset", *FITTED_MOTION):
        digest.update(np.ascontiguousarray(getattr(motion, name)).tobytes())
    for view in capture.train:
        c = view.camera
        numbers = (
            view.timestep,
            view.camera_index,
            view.image_path.stat().st_size,
            c.width,
            c.height,
            c.fx,
            c.fy,
            c.cx,
            c.cy,
        )
        digest.update(np.array([*numbers, *np.ravel(c.rotation), *np.ravel(c.translation)], np.float64).tobytes())
    return {
        "head": head.reference.sha256,
        "views": len(capture.train),
        "timesteps": len(motion),
        "sha256": digest.hexdigest(),
    }
