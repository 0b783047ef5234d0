"""Held-out views drawn from several avatars at once, so that what they share is done once: images, masks and poses."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from sacha_core.avatar.avatar import Avatar
from sacha_core.errors import DatasetError
from sacha_core.evaluate.picture_metrics import PictureMetrics, Quality
from sacha_core.evaluate.region_masks import RegionMasks
from sacha_core.evaluate.views import evaluation_motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

__all__ = ["judge_views"]

HIGHEST_PSNR = 100.0  # decibels; 8 bits hide what is beyond some 60


def judge_views(
    avatars: Sequence[Avatar],
    head: HeadModel,
    capture: Capture,
    views: Sequence[View],
    metrics: Collection[str],
    masks: RegionMasks,
    rasteriser: Rasteriser,
    report: Report = silent,
    stage: str = "judge",
) -> tuple[Quality, ...]:
    """Draw views of a capture from each avatar, and compare them with the captured images, at the stored size.

    Args:
        avatars: each moves by its own motion (see `evaluation_motion`).
        head: that they are bound to.
        capture: where the views are from.
        views: sorted by timestep.
        metrics: which to measure, of `picture_metrics.METRICS`.
        masks: where each region shows.
        rasteriser: draws them.
        report: told after each view.
        stage: what the report calls this.

    Returns:
        One for each avatar.

    Raises:
        DatasetError: there are no views, an image cannot be decoded, or a motion is another capture's.
    """
    if not views:
        raise DatasetError(f"{capture.root} has no held-out views to {stage}")
    poses = [Poser(head, evaluation_motion(capture, avatar.motion)) for avatar in avatars]
    measured = [PictureMetrics(metrics) for _ in avatars]
    timestep, frames = -1, list[TriangleFrames]()
    for done, view in enumerate(views, 1):
        if view.timestep != timestep:
            timestep = view.timestep
            frames = [triangle_frames(pose(timestep), head.faces) for pose in poses]
        truth, shown = capture.image(view), masks.region_of_pixel(view)
        for avatar, posed, metric in zip(avatars, frames, measured, strict=True):
            drawn = render_avatar(avatar.gaussians, posed, view.camera, rasteriser=rasteriser).colour
            metric.add(view, drawn, truth, shown)
        report(Progress(stage, done, len(views)))
    return tuple(finite(metric.scores().quality) for metric in measured)


def finite(quality: Quality) -> Quality:
    """Give the figures with a PSNR that a file can hold: where an image is hit exactly, it has no end."""
    return replace(quality, psnr=min(quality.psnr, HIGHEST_PSNR))
