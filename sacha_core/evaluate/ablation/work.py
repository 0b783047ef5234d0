"""The work of an ablation, stage by stage; each picks up what an earlier attempt left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.errors import DatasetError
from sacha_core.evaluate.ablation.allocation import empty_faces, region_results
from sacha_core.evaluate.ablation.coding import Coded, code
from sacha_core.evaluate.ablation.ledger import record_plan, standing
from sacha_core.evaluate.ablation.pictures import judge_views
from sacha_core.evaluate.ablation.plan import PlannedRun, WarmUp
from sacha_core.evaluate.ablation.result import Point, RunResult, write_result
from sacha_core.evaluate.ablation.spent import SpentTime, spent_seconds
from sacha_core.evaluate.picture_metrics import Quality
from sacha_core.evaluate.region_masks import RegionMasks
from sacha_core.evaluate.splits import novel_expression_views, novel_view_views
from sacha_core.evaluate.views import evaluation_motion
from sacha_core.evaluate.visibility import visible_gaussians
from sacha_core.flame.head_file import load_head
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.progress import Progress, Report
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.train.loop import train
from sacha_core.train.output import TrainedModel
from sacha_core.train.scene import fingerprint
from sacha_core.train.warm_up import train_warm_up

__all__ = ["TrainAndJudge", "TrainWarmUp"]


@dataclass(frozen=True)
class TrainWarmUp:
    """Train a warm-up that runs share.

    Args:
        warm_up: which.
        threads: how many work.
    """

    warm_up: WarmUp
    threads: int

    def __call__(self, report: Report) -> None:
        """Do it; see `train_warm_up`."""
        run, folder = self.warm_up.run, self.warm_up.folder
        capture, head = read_capture(run.dataset.root), load_head(run.dataset.head)
        spent = SpentTime(folder)
        told = spent.while_telling(named(self.warm_up.name, report))
        train_warm_up(capture, head, replace(run.options, threads=self.threads), folder, told)
        spent.keep()


@dataclass(frozen=True)
class TrainAndJudge:
    """Train a run, code what comes out, judge it, and write its result last.

    Args:
        run: which.
        warm_up: that it begins with; None to train from scratch.
        threads: how many work.
    """

    run: PlannedRun
    warm_up: WarmUp | None
    threads: int

    def __call__(self, report: Report) -> None:
        """Do it.

        Raises:
            SachaError: the capture or an option makes no sense, or training came to nothing that can be coded.
            OSError: a file cannot be read or written.
        """
        run = self.run
        capture, head = read_capture(run.dataset.root), load_head(run.dataset.head)
        if standing(run) == "to judge":
            run.result.unlink()
        record_plan(run, fingerprint(capture, head))
        told = named(run.name, report)
        trained, seconds = self._train(capture, head, told)
        judge(run, capture, head, trained, seconds, self.threads, told)

    def _train(self, capture: Capture, head: HeadModel, report: Report) -> tuple[TrainedModel, float]:
        """Train; give the seconds that it took, with those of the warm-up."""
        model = self.run.model
        spent = SpentTime(self.run.folder)
        options = replace(self.run.options, threads=self.threads)
        start_from = None if self.warm_up is None else self.warm_up.checkpoint
        trained = train(capture, head, options, model, spent.while_telling(report), start_from=start_from)
        seconds = spent.keep()
        return trained, seconds + (0.0 if self.warm_up is None else spent_seconds(self.warm_up.folder))


def judge(
    run: PlannedRun,
    capture: Capture,
    head: HeadModel,
    trained: TrainedModel,
    training_seconds: float,
    threads: int,
    report: Report,
) -> None:
    """Code and judge a trained run, and write its result."""
    rasteriser = Rasteriser(threads)
    avatar = Avatar(trained.gaussians, head.reference, trained.motion)
    report(Progress("encode", 0, len(run.judging.levels)))
    coded = code(avatar, head, run.judging.points, run.folder)
    view, expression = both_settings(run, capture, head, coded, rasteriser, report)
    first, motion = capture.train[0].camera, evaluation_motion(capture, trained.motion)
    visible = visible_gaussians(trained.gaussians, head, motion, capture.train, first.width, first.height, rasteriser)
    points = [
        Point(c.level, c.n, c.bytes, round(c.encode_s, 3), round(c.decode_s, 3), v, e)
        for c, v, e in zip(coded, view, expression, strict=True)
    ]
    result = RunResult(
        dataset=run.dataset.name,
        variant=run.variant,
        seed=run.options.seed,
        iterations=trained.iteration,
        n=len(trained.gaussians),
        n_visible=int(np.count_nonzero(visible)),
        empty_faces=empty_faces(trained.gaussians, head),
        training_seconds=round(training_seconds, 1),
        regions=region_results(trained.gaussians, visible, head, trained.events, run.options),
        points=tuple(points),
    )
    write_result(run.result, result)


def both_settings(
    run: PlannedRun,
    capture: Capture,
    head: HeadModel,
    coded: Sequence[Coded],
    rasteriser: Rasteriser,
    report: Report,
) -> tuple[tuple[Quality, ...], tuple[Quality, ...]]:
    """Judge novel views, then novel expressions, each for all levels at once."""
    limit, masks = run.judging.images, RegionMasks(capture, head)
    settings = {
        "judge novel views": novel_view_views(capture, limit),
        "judge novel expressions": novel_expression_views(capture, limit),
    }
    for stage, views in settings.items():
        if not views:
            raise DatasetError(f"{capture.root} has no held-out views to {stage}")
    avatars = [c.avatar for c in coded]
    view, expression = (
        judge_views(avatars, head, capture, views, run.judging, masks, rasteriser, report, stage)
        for stage, views in settings.items()
    )
    return view, expression


def named(name: str, report: Report) -> Report:
    """Give a report that puts a job's name before what it does."""

    def tell(progress: Progress) -> None:
        report(replace(progress, stage=f"{name}: {progress.stage}"))

    return tell
