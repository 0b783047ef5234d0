"""Drawing an avatar's frames as pictures for people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.cameras import Extent, extent_of
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER, RegionScheme

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
        self.gaussians = gaussians
        self.colours = colours
        self.motion = motion or Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
        self._faces = head.faces
        self._pose = Poser(head, self.motion)
        self._rasteriser = Rasteriser()

    def frames(self, frame: int) -> TriangleFrames:
        """Give the frames of the posed triangles.

        Raises:
            OptionError: the motion has no such frame.
        """
        if not 0 <= frame < len(self.motion):
            raise OptionError(f"frame {frame} does not exist; the motion has frames 0 to {len(self.motion) - 1}")
        return triangle_frames(self._pose(frame), self._faces)

    def extent(self, frame: int) -> Extent:
        """Give where the avatar lies in one frame."""
        world = to_world(self.gaussians, self.frames(frame))
        return extent_of(world.means, world.opacities)

    def draw(self, frame: int, cameras: Sequence[Camera]) -> UInt8[np.ndarray, "h w 3"]:
        """Draw one frame on white, once for each camera, side by side."""
        frames = self.frames(frame)
        pictures = [
            render_avatar(self.gaussians, frames, camera, colours=self.colours, rasteriser=self._rasteriser).colour
            for camera in cameras
        ]
        side_by_side: np.ndarray = np.clip(np.concatenate(pictures, axis=1), 0, 1)
        return np.round(255 * side_by_side).astype(np.uint8)


def region_colours(gaussians: Gaussians, head: HeadModel, scheme: RegionScheme = PAPER) -> Float[np.ndarray, "n 3"]:
    """Give each Gaussian the colour of the region that its triangle lies in.

    Raises:
        HeadError: the head has no masks, so its regions are not known.
    """
    palette = np.array(scheme.colours, np.float32) / 255
    colours: np.ndarray = palette[label_triangles(head, scheme)[gaussians.binding]]
    return colours
