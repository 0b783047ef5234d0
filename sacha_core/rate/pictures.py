"""What an avatar is fitted to when its file is made: its own pictures before compression, or those of a capture.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.views import different_frames, measuring_shots, stock_motion
from sacha_core.train.state import FITTED_MOTION
from sacha_core.train.views import Target, TrainingViews, box_of

__all__ = ["CaptureSteps", "own_pictures"]

OWN_FRAMES, OWN_CAMERAS = 30, 6
WHITE = 255


def own_pictures(
    avatar: Avatar, head: HeadModel, n_frames: int = OWN_FRAMES, n_cameras: int = OWN_CAMERAS
) -> tuple[Motion, list[tuple[Target, ...]]]:
    """Draw an avatar in poses that lie far from one another, from changing directions.

    Args:
        avatar: with its motion, or without: then in stock expressions.
        head: that it is bound to.
        n_frames: poses, at most.
        n_cameras: of each.

    Returns:
        The motion of these poses, and one picture a step; timesteps are of that motion.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    motion = avatar.motion if avatar.motion is not None and len(avatar.motion) else stock_motion(head)
    times = different_frames(motion, n_frames)
    poses = replace(motion, **{name: getattr(motion, name)[times] for name in FITTED_MOTION})
    rasteriser = Rasteriser()
    steps: list[tuple[Target, ...]] = []
    for timestep, shot in enumerate(measuring_shots(avatar, head, n_cameras, n_frames)):
        for camera in shot.cameras:
            drawn = render_avatar(avatar.gaussians, shot.frames, camera, rasteriser=rasteriser).colour
            image = np.ascontiguousarray(np.rint(np.clip(drawn, 0, 1) * WHITE).astype(np.uint8).transpose(2, 0, 1))
            nothing = np.zeros(image.shape[1:], np.uint8)
            steps.append((Target(timestep, camera, image, nothing, box_of((image != WHITE).any(axis=0))),))
    return poses, steps


@dataclass(frozen=True)
class CaptureSteps(Sequence[tuple[Target, ...]]):
    """The training views of a capture, one a step, decoded when they are asked for and kept.

    Args:
        views: of the capture.
    """

    views: TrainingViews

    @classmethod
    def of(cls, capture: Capture) -> CaptureSteps:
        """Give those of a capture."""
        return cls(TrainingViews(capture))

    def __len__(self) -> int:
        """Give the number of views."""
        return len(self.views)

    @overload
    def __getitem__(self, index: int) -> tuple[Target, ...]: ...
    @overload
    def __getitem__(self, index: slice) -> list[tuple[Target, ...]]: ...
    def __getitem__(self, index: int | slice) -> tuple[Target, ...] | list[tuple[Target, ...]]:
        """Give the view at `index`.

        Raises:
            DatasetError: its image cannot be decoded.
        """
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return (self.views[index],)
