"""Held-out views drawn from several avatars at once, so that what they share is done once: images, masks and poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sacha_core.avatar.avatar import Avatar
from sacha_core.errors import DatasetError
from sacha_core.evaluate.ablation.plan import Judging
from sacha_core.evaluate.picture_metrics import PictureMetrics, Quality
from sacha_core.evaluate.region_masks import RegionMasks
from sacha_core.evaluate.splits import spread
from sacha_core.evaluate.views import evaluation_motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

__all__ = ["judge_views"]

SLOW = frozenset({"flip", "lpips"})  # ten times what drawing and all other metrics take
HIGHEST_PSNR = 100.0  # decibels; 8 bits hide what is beyond some 60


def judge_views(
    avatars: Sequence[Avatar],
    head: HeadModel,
    capture: Capture,
    views: Sequence[View],
    judging: Judging,
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
        judging: which metrics to measure, and on how many of the views those that take long.
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
    slow = SLOW & set(judging.metrics)
    chosen = {id(view) for view in spread(views, judging.flip_images)} if slow else set[int]()
    everywhere = [PictureMetrics() for _ in avatars]
    somewhere = [PictureMetrics(slow) for _ in avatars]
    timestep, frames = -1, list[TriangleFrames]()
    for done, view in enumerate(views, 1):
        if view.timestep != timestep:
            timestep = view.timestep
            frames = [triangle_frames(pose(timestep), head.faces) for pose in poses]
        truth, shown = capture.image(view), masks.region_of_pixel(view)
        for avatar, posed, *metrics in zip(avatars, frames, everywhere, somewhere, strict=True):
            drawn = render_avatar(avatar.gaussians, posed, view.camera, rasteriser=rasteriser).colour
            for metric in metrics if id(view) in chosen else metrics[:1]:
                metric.add(view, drawn, truth, shown)
        report(Progress(stage, done, len(views)))
    if not slow:
        return tuple(finite(metric.scores().quality) for metric in everywhere)
    both = zip(everywhere, somewhere, strict=True)
    return tuple(finite(joined(fast.scores().quality, slow.scores().quality)) for fast, slow in both)


def joined(fast: Quality, slow: Quality) -> Quality:
    """Give the figures of all images, with those that take long from the few where they were measured."""
    regions = {
        name: replace(region, flip=slow.regions[name].flip) if name in slow.regions else region
        for name, region in fast.regions.items()
    }
    return replace(fast, flip=slow.flip, lpips_vgg=slow.lpips_vgg, lpips_alex=slow.lpips_alex, regions=regions)


def finite(quality: Quality) -> Quality:
    """Give the figures with a PSNR that a file can hold: where an image is hit exactly, it has no end."""
    return replace(quality, psnr=min(quality.psnr, HIGHEST_PSNR))
