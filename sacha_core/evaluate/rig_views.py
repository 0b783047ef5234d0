"""Views of an avatar without a capture: the calibrated rig, set up round the head wherever its motion takes it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.animation.player import Player, PlayOptions
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.perception.sensitivity_map import sensitivity_map
from sacha_core.raster.camera import Camera
from sacha_core.synthesis.cameras import N_CAMERAS, TARGET_M, camera_rig
from sacha_core.train.views import Target, box_of

__all__ = ["rig_round", "rig_targets", "spread_frames"]

RIG_HALF_HEIGHT_M = 0.16  # of the head and neck that the rig is calibrated for
WHITE = 255


def rig_round(vertices: Float[np.ndarray, "v 3"], width: int, height: int) -> tuple[Camera, ...]:
    """Give the rig's cameras as they would stand for a head of this place and size.

    Args:
        vertices: (v, 3) of the posed head, metres.
        width: of the pictures, pixels.
        height: pixels.
    """
    low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
    middle, scale = (low + high) / 2, (high[1] - low[1]) / 2 / RIG_HALF_HEIGHT_M
    moved = []
    for camera in camera_rig(width, height):
        eye = middle + scale * (camera.centre - np.array(TARGET_M))
        moved.append(replace(camera, translation=-camera.rotation @ eye))
    return tuple(moved)


def spread_frames(n_frames: int, n_views: int) -> list[int]:
    """Give evenly spaced frames of which the whole rig makes about so many views; at least one frame, at most all."""
    wanted = min(max(round(n_views / N_CAMERAS), 1), n_frames)
    frames: list[int] = np.linspace(0, n_frames - 1, wanted).round().astype(int).tolist()
    return frames


def rig_targets(
    gaussians: Gaussians,
    head: HeadModel,
    motion: Motion,
    frames: list[int],
    width: int,
    height: int,
    pad: Literal["replicate", "zero"] = "replicate",
    threads: int | None = None,
) -> Iterator[tuple[Target, ...]]:
    """Draw an avatar from the rig, frame after frame, and mark where its own pictures are sensitive.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        motion: what it does.
        frames: which frames of the motion.
        width: of the pictures, pixels.
        height: pixels.
        pad: see `sensitivity_map`.
        threads: how many draw; None for as many as there are cores.

    Yields:
        The sixteen views of each frame.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    pose = Poser(head, motion)
    with closing(Player(gaussians, head, motion, PlayOptions(threads=threads))) as player:
        for frame in frames:
            cameras = rig_round(pose(frame), width, height)
            yield tuple(_target(player.frame(frame, camera), frame, camera, pad) for camera in cameras)


def _target(picture: np.ndarray, frame: int, camera: Camera, pad: Literal["replicate", "zero"]) -> Target:
    """Make a view of a picture, (h, w, 3) uint8, which is only looked at."""
    sensitive = sensitivity_map(picture, pad)
    planar = np.ascontiguousarray(picture.transpose(2, 0, 1))
    marked = (planar != WHITE).any(axis=0) | sensitive
    return Target(frame, camera, planar, sensitive.astype(np.uint8) * np.uint8(255), box_of(marked))
