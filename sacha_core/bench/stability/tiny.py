"""Captures small enough to train on in a second: the small synthetic head, a few cameras, pictures of some thousand pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from sacha_core.animation.posed import PosedHead
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import joint_vectors
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar
from sacha_core.train.options import TrainOptions
from sacha_core.train.presets import scaled

__all__ = ["capture_of", "eventful", "film", "ring", "tiny_head", "tiny_motion"]

WIDTH, HEIGHT = 40, 48  # pixels
DISTANCE_M = 0.8
FOCAL = 120.0  # pixels: the head fills the picture
AIM = np.array([0.0, -0.02, -0.04])

Picture = Callable[[View, HeadModel, Motion], UInt8[np.ndarray, "h w c"]]


def tiny_head() -> HeadModel:
    """Give the head: some 650 triangles, five joints, all masks."""
    return synthetic_head("small")


def tiny_motion(n_frames: int) -> Motion:
    """Give a motion that turns the head and moves the face."""
    head, rng = tiny_head(), np.random.default_rng(12)

    def normal(spread: float, width: int) -> Float[np.ndarray, "t w"]:
        return rng.normal(0, spread, (n_frames, width)).astype(np.float32)

    rest = Motion.rest(head.shapedirs.shape[2], 6, n_frames)
    return replace(rest, expression=normal(0.5, 6), rotation=normal(0.3, 3), jaw=np.abs(normal(0.1, 3)))


def ring(n_cameras: int, radius_m: float = DISTANCE_M, width: int = WIDTH, height: int = HEIGHT) -> tuple[Camera, ...]:
    """Give cameras around the head, alternately above and below it; one is in front."""
    cameras = []
    for k in range(n_cameras):
        angle = 2 * np.pi * k / n_cameras
        eye = AIM + radius_m * np.array([np.sin(angle), 0.3 * (-1) ** k, np.cos(angle)])
        cameras.append(Camera.look_at(eye, AIM, width, height, FOCAL * width / WIDTH))
    return tuple(cameras)


def film(view: View, head: HeadModel, motion: Motion) -> UInt8[np.ndarray, "h w 3"]:
    """Picture a coloured head: large, solid Gaussians, the same in every view."""
    true = initial_gaussians(head.n_faces, np.random.default_rng(13), 0)
    colours = np.random.default_rng(14).random((head.n_faces, 3), np.float32)
    true = replace(true, opacity_logit=np.full(head.n_faces, 4, np.float32), log_scale=true.log_scale - np.float32(0.7))
    pose = PosedHead(head, motion).pose(
        motion.expression[view.timestep], joint_vectors(motion, view.timestep), motion.translation[view.timestep]
    )
    picture = render_avatar(true, pose.frames, view.camera, colours=colours)
    pixels: np.ndarray = (np.clip(picture.colour, 0, 1) * 255).round().astype(np.uint8)
    return pixels


def capture_of(folder: Path, cameras: Sequence[Camera], n_frames: int, picture: Picture = film) -> Capture:
    """Write a capture: every camera at every timestep.

    Args:
        folder: where the pictures go.
        cameras: at their stored resolution.
        n_frames: timesteps.
        picture: gives the pixels of a view.
    """
    head, motion = tiny_head(), tiny_motion(n_frames)
    views = [
        View(timestep, index, camera, folder / f"{timestep}_{index}.png", None)
        for timestep in range(n_frames)
        for index, camera in enumerate(cameras)
    ]
    for view in views:
        Image.fromarray(picture(view, head, motion)).save(view.image_path)
    return Capture(folder, head.reference, None, motion, tuple(views), (), ())


def eventful(iterations: int, variant: str = "sacha", threads: int = 1) -> TrainOptions:
    """Give options of a short run with every kind of event: two calibrations, prunings, densifications, resets of opacity.

    Args:
        iterations: of the run, at least 20.
        variant: whose rules.
        threads: how many.
    """
    made = scaled(iterations, variant, TrainOptions(threads=threads, sh_degree=1, device="cpu"))
    warm_up = made.schedule.warm_up
    schedule = replace(
        made.schedule,
        calibrations=(warm_up, 2 * warm_up),
        densify_every=4,
        densify_from=3,
        densify_until=2 * warm_up,
        size_prune_from=warm_up,
    )
    density = replace(made.density, threshold=4e-4, threshold_lowest=2e-4, threshold_highest=8e-4)
    return replace(made, schedule=schedule, density=density)
