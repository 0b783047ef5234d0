"""What codecs are judged by: pictures of a posed avatar from all around, uncompressed and decoded.

The views are those that files are judged by everywhere (`sacha_core.rate.views.protocol_shots`), posed by the avatar's own motion,
uncompressed for all; PSNR of each picture over the pixels that the uncompressed avatar covers, averaged. SSIM (whole picture) and FLIP (the
same pixels) are looked at on some of the pictures.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.codec_free import free_shots
from sacha_core.bench.preset import Subject
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.perception.flip import flip_map
from sacha_core.perception.flip import missing as flip_lacks
from sacha_core.perception.psnr import psnr_over
from sacha_core.perception.ssim import ssim
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.judging import COVERED
from sacha_core.rate.views import Shot, protocol_shots

__all__ = ["Extent", "Scene", "Scores", "judge", "make_scene", "scene_of"]

K = TypeVar("K", bound=Hashable)
STILL_CLOSELY = 3  # of sixteen pictures at most


@dataclass(frozen=True)
class Extent:
    """How much is looked at.

    Args:
        frames: of the motion.
        every: which cameras: each, every second, ...
        closely: every how many pictures SSIM and FLIP are measured, too.
        scale: of the pictures' sides.
    """

    frames: int = 12
    every: int = 1
    closely: int = 17
    scale: float = 1.0


@dataclass(frozen=True)
class Scene:
    """Poses and cameras.

    Args:
        gaussians: of the uncompressed avatar.
        shots: poses and the cameras that see each.
        closely: every how many pictures SSIM and FLIP are measured, too.
    """

    gaussians: Gaussians
    shots: tuple[Shot, ...]
    closely: int


@dataclass(frozen=True)
class Scores:
    """How close decoded pictures come to uncompressed ones.

    Args:
        psnr: decibels, mean over all pictures of each one's over the avatar's own pixels.
        lowest_psnr: of the worst picture.
        ssim: mean of some pictures, whole.
        flip: mean error of the same over the avatar's own pixels; None where the package is missing.
    """

    psnr: float
    lowest_psnr: float
    ssim: float
    flip: float | None


def make_scene(avatar: Avatar, head: HeadModel, extent: Extent) -> Scene:
    """Choose poses and place cameras.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        OptionError: the avatar has no motion.
    """
    motion = avatar.motion
    if motion is None or not len(motion):
        raise OptionError(
            "codecs are compared on posed frames, and the avatar has no motion; name one with --motion FILE"
        )
    shots = protocol_shots(avatar, head, extent.frames, extent.scale)
    fewer = tuple(Shot(shot.stance, shot.cameras[:: extent.every]) for shot in shots)
    return Scene(avatar.gaussians, fewer, extent.closely)


def scene_of(subject: Subject, extent: Extent) -> Scene:
    """Choose poses and place cameras; splats without a head stand still, seen from all around.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        OptionError: a bound avatar has no motion.
    """
    if subject.bound:
        return make_scene(subject.avatar, subject.head, extent)
    shots = tuple(Shot(shot.stance, shot.cameras[:: extent.every]) for shot in free_shots(subject, extent.scale))
    return Scene(subject.avatar.gaussians, shots, STILL_CLOSELY)


def judge(
    scene: Scene, decoded: Mapping[K, Gaussians], rasteriser: Rasteriser, report: Report = silent
) -> dict[K, Scores]:
    """Compare the pictures of decoded avatars with those of the uncompressed one, picture after picture.

    Args:
        scene: poses and cameras.
        decoded: by any names.
        rasteriser: draws.
        report: told about progress.
    """
    ratios: dict[K, list[float]] = {name: [] for name in decoded}
    likeness: dict[K, list[float]] = {name: [] for name in decoded}
    errors: dict[K, list[float]] = {name: [] for name in decoded}
    with_flip = flip_lacks() is None
    views = [(shot.frames, camera) for shot in scene.shots for camera in shot.cameras]
    for number, (pose, camera) in enumerate(views):
        report(Progress("judge pictures", number, len(views)))
        drawn = render_avatar(scene.gaussians, pose, camera, rasteriser=rasteriser)
        own, truth = drawn.alpha > COVERED, np.clip(drawn.colour, 0, 1)
        for name, gaussians in decoded.items():
            colour = render_avatar(gaussians, pose, camera, rasteriser=rasteriser).colour
            picture = np.clip(colour, 0, 1)
            ratios[name].append(psnr_over(picture, truth, own))
            if number % scene.closely == 0:
                likeness[name].append(ssim(picture, truth))
                if with_flip and own.any():
                    errors[name].append(float(flip_map(picture, truth)[own].mean()))
    report(Progress("judge pictures", len(views), len(views)))
    return {
        name: Scores(
            float(np.mean(ratios[name])), min(ratios[name]), float(np.mean(likeness[name])),
            float(np.mean(errors[name])) if errors[name] else None,
        )
        for name in decoded
    }  # fmt: skip
