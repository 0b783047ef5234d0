"""Drawing an avatar as the capture's cameras saw the person, and measuring how far off it is."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import DYNAMIC_WIDTHS, Motion
from sacha_core.errors import DatasetError
from sacha_core.evaluate.picture_metrics import DEFAULT_METRICS, ImageScore, PictureMetrics, ViewScores
from sacha_core.evaluate.region_masks import RegionMasks
from sacha_core.evaluate.splits import FRAMES, novel_expression_views, novel_view_views
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

__all__ = ["Evaluation", "ImageScore", "ViewScores", "evaluate_avatar", "evaluation_motion", "score_views"]


@dataclass(frozen=True)
class Evaluation:
    """How an avatar does on what training never saw.

    Args:
        novel_view: the held-out camera, at training timesteps.
        novel_expression: held-out timesteps, by all cameras.
    """

    novel_view: ViewScores
    novel_expression: ViewScores


def score_views(
    gaussians: Gaussians,
    head: HeadModel,
    motion: Motion,
    capture: Capture,
    views: Sequence[View],
    width: int | None = None,
    height: int | None = None,
    report: Report = silent,
    stage: str = "render",
    rasteriser: Rasteriser | None = None,
    metrics: Collection[str] = DEFAULT_METRICS,
    masks: RegionMasks | None = None,
) -> ViewScores:
    """Draw views of a capture and compare each with its image.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        motion: frame t is the capture's timestep t.
        capture: where the views are from.
        views: what to draw, at least one.
        width: pixels; the stored width by default.
        height: pixels; the stored height by default.
        report: told after each image.
        stage: what the report calls this.
        rasteriser: one to use again; a new one by default.
        metrics: what to measure, of `picture_metrics.METRICS`.
        masks: the capture's regions, to measure within each of them too.

    Returns:
        Scores in the order of `views`; `.quality` gives their means.

    Raises:
        DatasetError: there are no views, or an image cannot be decoded.
        OptionError: there is no such metric, or its package is missing.
    """
    if not views:
        raise DatasetError(f"{capture.root} has no held-out views to {stage}")
    rasteriser = rasteriser or Rasteriser()
    pose = Poser(head, motion)

    @lru_cache(maxsize=1)  # views come in order of timesteps
    def frames_at(timestep: int) -> TriangleFrames:
        return triangle_frames(pose(timestep), head.faces)

    measured = PictureMetrics(metrics) if masks is None else PictureMetrics(metrics, masks.scheme)
    for done, view in enumerate(views, 1):
        truth = capture.image(view, width, height)
        camera = view.camera.resized(truth.shape[1], truth.shape[0])
        drawn = render_avatar(gaussians, frames_at(view.timestep), camera, rasteriser=rasteriser).colour
        shown = None if masks is None else masks.region_of_pixel(view, camera.width, camera.height)
        score = measured.add(view, drawn, truth, shown)
        report(Progress(stage, done, len(views), {"PSNR": score.psnr}))
    return measured.scores()


def evaluation_motion(capture: Capture, fitted: Motion | None) -> Motion:
    """Give the motion that an avatar is judged with.

    An avatar moves by its own parameters, as far as they reach: a trained model's motion carries the tracked ones of held-out timesteps
    unchanged, and a compressed avatar's are what decoding gives back. Timesteps beyond its end are driven by the capture's tracked
    parameters.

    Args:
        capture: the capture that was trained on.
        fitted: the avatar's own motion, whose frame t is timestep t; None for an avatar without one.

    Raises:
        DatasetError: the fitted motion ends before the last training timestep, or is of another width.

    Source: SACHA, experiments: decoded avatars are judged with their decoded FLAME parameters.
    """
    tracked = capture.motion
    if fitted is None:
        return tracked
    last = max(view.timestep for view in (*capture.train, *capture.val))
    if last >= len(fitted):
        raise DatasetError(
            f"the avatar's motion has {len(fitted)} frames, but {capture.root} trains on timesteps up to {last}; "
            "is it another capture's?"
        )
    n_own = min(len(fitted), len(tracked))
    mixed = {}
    for name in ("expression", *DYNAMIC_WIDTHS):
        values, own = getattr(tracked, name).copy(), getattr(fitted, name)
        if own.shape[1] != values.shape[1]:
            raise DatasetError(
                f"the avatar's motion has {own.shape[1]} numbers of {name} a frame, {capture.root} has {values.shape[1]}"
            )
        values[:n_own] = own[:n_own]
        mixed[name] = values
    return replace(tracked, shape=fitted.shape, static_offset=fitted.static_offset, **mixed)


def evaluate_avatar(
    gaussians: Gaussians,
    head: HeadModel,
    capture: Capture,
    fitted: Motion | None = None,
    width: int | None = None,
    height: int | None = None,
    limit: int = FRAMES,
    report: Report = silent,
    rasteriser: Rasteriser | None = None,
    metrics: Collection[str] = DEFAULT_METRICS,
    masks: RegionMasks | None = None,
) -> Evaluation:
    """Judge an avatar on the held-out camera and the held-out timesteps of its capture.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        capture: the capture that was trained on.
        fitted: the avatar's own motion; see `evaluation_motion`.
        width: pixels; the stored width by default.
        height: pixels; the stored height by default.
        limit: at most so many images for each of the two.
        report: told after each image.
        rasteriser: one to use again; a new one by default.
        metrics: what to measure, of `picture_metrics.METRICS`.
        masks: the capture's regions, to measure within each of them too.

    Raises:
        OptionError: there is no such metric, or its package is missing.
        DatasetError: a split is empty, an image cannot be decoded, or the motion is another capture's.

    Source: SACHA, experiments.
    """
    motion = evaluation_motion(capture, fitted)
    rasteriser = rasteriser or Rasteriser()
    chosen = {
        "novel view": novel_view_views(capture, limit),
        "novel expression": novel_expression_views(capture, limit),
    }
    scores = [
        score_views(gaussians, head, motion, capture, views, width, height, report, stage, rasteriser, metrics, masks)
        for stage, views in chosen.items()
    ]
    return Evaluation(*scores)
