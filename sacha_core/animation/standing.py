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
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames

__all__ = ["Standing", "standing_on"]


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
        return standing_on(self._gaussians, triangle_frames(self._poser(frame), self._faces))


def standing_on(gaussians: Gaussians, frames: TriangleFrames) -> Gaussians:
    """Give canonical Gaussians as they stand on a posed head, as `Standing` does.

    Args:
        gaussians: n canonical ones.
        frames: of each triangle of the posed head.

    Raises:
        GeometryError: a Gaussian is bound to a triangle that has no frame.
    """
    world = to_world(gaussians, frames)
    log_scale = gaussians.log_scale + np.log(frames.scale)[gaussians.binding, None]
    return replace(gaussians, position=world.means, log_scale=log_scale, quaternion=world.quaternions)
