"""How near avatars come to pictures, region by region: to those of a capture, or to their own before they were made smaller."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.evaluate.region_masks import RegionMasks, region_mask
from sacha_core.evaluate.rig_views import rig_round, spread_frames
from sacha_core.evaluate.splits import novel_expression_views, novel_view_views
from sacha_core.evaluate.views import evaluation_motion, score_views
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.regions.partition import Partition

__all__ = ["REGION_VIEWS", "capture_region_psnr", "own_region_psnr"]

REGION_VIEWS = 48  # more change the figures by some hundredths of a decibel
SIZE = (550, 802)  # pixels, as files are judged
Decibels = tuple[float | None, ...]


def own_region_psnr(
    truth: Gaussians,
    found: Sequence[Gaussians],
    head: HeadModel,
    motion: Motion | None,
    partition: Partition,
    n_views: int = REGION_VIEWS,
    size: tuple[int, int] = SIZE,
    report: Report = silent,
) -> list[Decibels]:
    """Measure PSNR against an avatar's own pictures, from the calibrated rig, within each region.

    All are posed by the same motion. A pixel is of the region that the mesh shows there.

    Args:
        truth: the avatar's Gaussians before.
        found: what became of them, once or several times.
        head: the head that all are bound to.
        motion: what the avatar does; None for the head at rest.
        partition: the head's regions.
        n_views: about how many: all sixteen cameras at evenly spaced frames.
        size: width and height of the pictures, pixels.
        report: told after each view.

    Returns:
        For each of `found` decibels by region; None where nothing differs, or no pixel shows the region.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    motion = (
        motion if motion is not None and len(motion) else Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
    )
    pose, rasteriser = Poser(head, motion), Rasteriser()
    faces = np.ascontiguousarray(head.faces, np.int32)
    n_regions = len(partition.regions)
    errors, pixels = np.zeros((len(found), n_regions)), np.zeros(n_regions)
    frames = spread_frames(len(motion), n_views)
    for place, time in enumerate(frames):
        vertices = pose(time)
        posed, cameras = triangle_frames(vertices, head.faces), rig_round(vertices, *size)
        for seen, camera in enumerate(cameras):
            mask = region_mask(vertices, faces, partition.labels, camera)
            shown = mask < n_regions
            labels = mask[shown]
            true, *drawn = (
                np.clip(render_avatar(of, posed, camera, rasteriser=rasteriser).colour[shown], 0, 1)
                for of in (truth, *found)
            )
            pixels += np.bincount(labels, minlength=n_regions)
            for row, picture in enumerate(drawn):
                squared = np.square(picture - true, dtype=np.float64).sum(axis=1)
                errors[row] += np.bincount(labels, squared, n_regions)
            report(Progress("measure regions", place * len(cameras) + seen + 1, len(frames) * len(cameras)))
    return [decibels(of, pixels) for of in errors]


def decibels(squared: Float[np.ndarray, " r"], pixels: Float[np.ndarray, " r"]) -> Decibels:
    """Give PSNR from squared errors summed over three channels; None where there are none."""
    return tuple(
        float(-10 * np.log10(error / (3 * n))) if error > 0 else None for error, n in zip(squared, pixels, strict=True)
    )


def capture_region_psnr(
    avatar: Avatar,
    head: HeadModel,
    capture: Capture,
    partition: Partition,
    n_views: int = REGION_VIEWS,
    report: Report = silent,
) -> Decibels:
    """Measure PSNR against the held-out images of a capture within each region, over both kinds of them together.

    Args:
        avatar: with its motion.
        head: the head that it is bound to.
        capture: that it was trained on.
        partition: the head's regions.
        n_views: at most so many.
        report: told after each image.

    Returns:
        Decibels by region; None where no pixel shows it.

    Raises:
        DatasetError: there are no held-out images, one cannot be decoded, or the motion is another capture's.
    """
    views = (*novel_view_views(capture, n_views // 2), *novel_expression_views(capture, n_views // 2))
    motion, masks = evaluation_motion(capture, avatar.motion), RegionMasks(capture, head, partition)
    scores = score_views(
        avatar.gaussians,
        head,
        motion,
        capture,
        views,
        report=report,
        stage="measure regions",
        metrics=("psnr",),
        masks=masks,
    )
    return tuple(scores.regions[name].psnr for name in partition.regions)
