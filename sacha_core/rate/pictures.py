"""What an avatar is fitted to when its file is made: its own pictures before compression, or those of a capture.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.stances import different_frames, stances_of, stock_motion
from sacha_core.rate.views import spread_shots
from sacha_core.train.state import FITTED_MOTION
from sacha_core.train.views import Target, TrainingViews, box_of

__all__ = ["CaptureSteps", "own_pictures"]

OWN_FRAMES, STOCK_FRAMES, CAMERAS = (
    24,
    6,
    5,
)  # poses of the motion and of stock expressions, and from how many sides each
WHITE = 255


def own_pictures(
    avatar: Avatar,
    head: HeadModel,
    n_frames: int = OWN_FRAMES,
    n_cameras: int = CAMERAS,
    n_stock: int = STOCK_FRAMES,
    share: float = 1.0,
) -> tuple[Motion, list[tuple[Target, ...]]]:
    """Draw an avatar in poses that lie far from one another, from changing directions.

    At the resolution of `views.protocol_shots`: Gaussians fitted to pictures of half of it look 2 dB worse there.

    Args:
        avatar: with its motion, or without: then in stock expressions only.
        head: that it is bound to.
        n_frames: poses of its motion, at most.
        n_cameras: of each pose.
        n_stock: stock expressions, at most, that its motion may lack.
        share: of the resolution.

    Returns:
        The motion of these poses, and one picture a step; timesteps are of that motion.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    poses = poses_to_learn(avatar, head, n_frames, n_stock)
    rasteriser, nothing = Rasteriser(), None
    steps: list[tuple[Target, ...]] = []
    stances = stances_of(avatar, head, poses, range(len(poses)))
    for timestep, shot in enumerate(spread_shots(stances, n_cameras, share)):
        for camera in shot.cameras:
            drawn = render_avatar(avatar.gaussians, shot.frames, camera, rasteriser=rasteriser).colour
            image = np.ascontiguousarray(np.rint(np.clip(drawn, 0, 1) * WHITE).astype(np.uint8).transpose(2, 0, 1))
            nothing = np.zeros(image.shape[1:], np.uint8) if nothing is None else nothing  # one for all
            steps.append((Target(timestep, camera, image, nothing, box_of((image != WHITE).any(axis=0))),))
    return poses, steps


def poses_to_learn(avatar: Avatar, head: HeadModel, n_frames: int, n_stock: int) -> Motion:
    """Give frames of an avatar's motion, and stock expressions: all of them where it has no motion."""
    if avatar.motion is None or not len(avatar.motion):
        stock = stock_motion(head)
        return stock.frames(np.array(different_frames(stock, n_frames)))
    own, stock = avatar.motion, stock_motion(head, avatar.motion)
    parts = (
        own.frames(np.array(different_frames(own, n_frames))),
        stock.frames(np.array(different_frames(stock, n_stock))),
    )
    columns = parts[1].expression.shape[1]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in FITTED_MOTION if name != "expression"
    }
    wide = [np.pad(part.expression, ((0, 0), (0, columns - part.expression.shape[1]))) for part in parts]
    return replace(own, **joined, expression=np.concatenate(wide))


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
