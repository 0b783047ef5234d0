"""Drawing an avatar's frames as pictures for people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.animation.player import Player
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.cameras import Extent, extent_of
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.regions.partition import partition_by
from sacha_core.regions.scheme import find_scheme

__all__ = ["Stage", "region_colours"]


class Stage:
    """An avatar that can be drawn at any frame.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        motion: what it does; None for the head at rest.
        colours: (n, 3) to draw instead of the Gaussians' own.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        head: HeadModel,
        motion: Motion | None,
        colours: Float[np.ndarray, "n 3"] | None = None,
    ) -> None:
        self.motion = motion or Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
        self._gaussians, self._head = gaussians, head
        self._player = Player(gaussians, head, self.motion, colours=colours)

    def extent(self, frame: int) -> Extent:
        """Give where the avatar lies in one frame.

        Raises:
            OptionError: the motion has no such frame.
        """
        self._player.seek(frame)
        frames = triangle_frames(Poser(self._head, self.motion)(frame), self._head.faces)
        world = to_world(self._gaussians, frames)
        return extent_of(world.means, world.opacities)

    def draw(self, frame: int, cameras: Sequence[Camera]) -> UInt8[np.ndarray, "h w 3"]:
        """Draw one frame on white, once for each camera, side by side.

        Raises:
            OptionError: the motion has no such frame.
        """
        return np.concatenate([self._player.frame(frame, camera).copy() for camera in cameras], axis=1)

    def close(self) -> None:
        """End the player's thread."""
        self._player.close()


def region_colours(head: HeadModel, scheme: str) -> Float[np.ndarray, "f 3"]:
    """Give each triangle the colour of the region that it lies in, sRGB in [0, 1].

    Args:
        head: whose regions.
        scheme: the name that the avatar goes by.

    Raises:
        HeadError: the head has no masks, so its regions are not known.
        OptionError: there is no such scheme.
    """
    colours: np.ndarray = partition_by(head, find_scheme(scheme)).triangle_colours / np.float32(255)
    return colours
