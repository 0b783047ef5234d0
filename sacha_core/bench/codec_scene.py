"""What codecs are judged by: pictures of a posed avatar from all around, uncompressed and decoded.

The protocol: cameras a metre from the middle of the head at rest, eight azimuths from -75 to 75 degrees at elevations of -8 and 14 degrees;
twelve frames spread over the avatar's own motion, uncompressed for all; 550 x 802 pixels on white; PSNR of each picture over the pixels
that the uncompressed avatar covers, averaged. SSIM (whole picture) and FLIP (the same pixels) are looked at on some of the pictures.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers.peer import Ground
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.perception.flip import flip_map
from sacha_core.perception.flip import missing as flip_lacks
from sacha_core.perception.ssim import ssim
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

__all__ = ["Extent", "Scene", "Scores", "judge", "make_scene", "own_psnr"]

K = TypeVar("K", bound=Hashable)
ELEVATIONS, AZIMUTHS = (-8.0, 14.0), np.linspace(-75, 75, 8)  # degrees
DISTANCE_M, FOCAL, SIZE = 1.0, 1500.0, (550, 802)
COVERED = 0.01  # of a pixel, from which it is the avatar's own
SOLID = 0.1  # opacity of Gaussians that tell where the head is
LEAST_ERROR = 1e-12  # mean squared, of pictures that are the same


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
        poses: frames of the triangles of each posed head.
        cameras: that see every pose.
        closely: every how many pictures SSIM and FLIP are measured, too.
    """

    gaussians: Gaussians
    poses: tuple[TriangleFrames, ...]
    cameras: tuple[Camera, ...]
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
        OptionError: the avatar has no motion.
    """
    motion = avatar.motion
    if motion is None or not len(motion):
        raise OptionError(
            "codecs are compared on posed frames, and the avatar has no motion; name one with --motion FILE"
        )
    times = np.unique(np.round(np.linspace(0, len(motion) - 1, extent.frames)).astype(int))
    pose = Poser(head, motion)
    poses = tuple(triangle_frames(pose(int(time)), head.faces) for time in times)
    cameras = tuple(cameras_of(avatar.gaussians, head, extent.scale)[:: extent.every])
    return Scene(avatar.gaussians, poses, cameras, extent.closely)


def cameras_of(gaussians: Gaussians, head: HeadModel, scale: float = 1.0) -> list[Camera]:
    """Give the protocol's cameras."""
    heights = Ground(head).to_domain(gaussians, "world")
    solid = heights.position[heights.opacity_logit > np.log(SOLID / (1 - SOLID)), 1]
    tall = solid if len(solid) else heights.position[:, 1]
    centre = np.array([0.0, (float(tall.min()) + float(tall.max())) / 2, 0.0])
    width, height = (max(round(side * scale), 1) for side in SIZE)
    found = []
    for elevation in np.radians(ELEVATIONS):
        for azimuth in np.radians(AZIMUTHS):
            away = np.array(
                [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
            )
            found.append(Camera.look_at(centre + DISTANCE_M * away, centre, width, height, FOCAL * scale))
    return found


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
    views = [(pose, camera) for pose in scene.poses for camera in scene.cameras]
    for number, (pose, camera) in enumerate(views):
        report(Progress("judge pictures", number, len(views)))
        drawn = render_avatar(scene.gaussians, pose, camera, rasteriser=rasteriser)
        own, truth = drawn.alpha > COVERED, np.clip(drawn.colour, 0, 1)
        for name, gaussians in decoded.items():
            colour = render_avatar(gaussians, pose, camera, rasteriser=rasteriser).colour
            picture = np.clip(colour, 0, 1)
            ratios[name].append(own_psnr(picture, truth, own))
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


def own_psnr(
    picture: Float[np.ndarray, "h w 3"], truth: Float[np.ndarray, "h w 3"], own: Bool[np.ndarray, "h w"]
) -> float:
    """Give PSNR over some pixels, decibels; 120 where nothing differs."""
    error = picture[own].astype(np.float64) - truth[own]
    return float(-10 * np.log10(max(float((error * error).mean()) if error.size else 0.0, LEAST_ERROR)))
