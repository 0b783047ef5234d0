"""An avatar's Gaussians where they stand in a frame, as other programs keep them: before the exponential and the sigmoid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames

__all__ = ["Standing"]


class Standing:
    """Gives an avatar's Gaussians in the world, frame by frame, all of them and in their order.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        motion: what it does; None for the head at rest.

    Raises:
        FormatError: a Gaussian is not finite, or bound to a triangle that the head lacks.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(self, gaussians: Gaussians, head: HeadModel, motion: Motion | None) -> None:
        gaussians.validate(head.n_faces)
        self.motion = motion or Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
        self._gaussians, self._faces = gaussians, head.faces
        self._poser = Poser(head, self.motion)

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.motion)

    def __call__(self, frame: int) -> Gaussians:
        """Give the Gaussians of one frame, float32.

        Args:
            frame: of the motion.

        Returns:
            Positions in metres of the world, logarithms of standard deviations in metres, unit quaternions that turn to the world's axes;
            opacity logits and harmonics, whose axes are the world's anyway, as they are. The binding is kept.

        Raises:
            OptionError: the motion has no such frame.
            GeometryError: the pose makes a triangle degenerate.

        Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4, the scale's in logarithms.
        """
        if not 0 <= frame < len(self):
            raise OptionError(f"frame {frame} does not exist; the motion has frames 0 to {len(self) - 1}")
        frames = triangle_frames(self._poser(frame), self._faces)
        world = to_world(self._gaussians, frames)
        log_scale = self._gaussians.log_scale + np.log(frames.scale)[self._gaussians.binding, None]
        return replace(self._gaussians, position=world.means, log_scale=log_scale, quaternion=world.quaternions)
