"""Where the camera rig stands so that an avatar fills its pictures as the synthetic head does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.synthesis.cameras import DISTANCE_M, camera_rig

__all__ = ["Framing", "frame_avatar"]

LEAST_DISTANCE = 3.0  # in half widths of the head
SIDE = 160  # pixels of the pictures by which the avatar is measured
ROOMY = 2.0  # how many times the size of the mesh they show
SHOWS = 0.5  # alpha of what has to fit
TALL = 0.88  # share of the picture's height from crown to neck cut at most, in any of the cameras: a turned head still fits
WIDE = 0.90  # likewise of its width
HEAD = (
    0.6  # share of that height, from the crown, where there is head and neck: shoulders below may go beyond the picture
)


@dataclass(frozen=True)
class Framing:
    """How the rig is moved and its lenses are changed.

    Args:
        target_m: (3,) the point that all cameras look at.
        distance_m: from there to the cameras.
        height_m: what a picture's height shows at that distance.
    """

    target_m: Float[np.ndarray, "3"]
    distance_m: float
    height_m: float

    def rig(self, width: int, height: int) -> tuple[Camera, ...]:
        """Give the sixteen cameras of `camera_rig` so framed."""
        return camera_rig(width, height, self.target_m, self.distance_m, self.distance_m / self.height_m)


def frame_avatar(
    gaussians: Gaussians, vertices: Float[np.ndarray, "v 3"], frames: TriangleFrames, width: int, height: int
) -> Framing:
    """Frame an avatar at rest: from the crown, hair included, to where the head's mesh ends, as large as fits from all cameras.

    Args:
        gaussians: of the avatar.
        vertices: (v, 3) of the head at rest, metres.
        frames: of its triangles.
        width: of the pictures, pixels.
        height: pixels.

    Raises:
        OptionError: nothing of the avatar shows.
        GeometryError: a Gaussian is bound to a triangle that the head lacks.
    """
    low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
    size = high - low
    distance = max(DISTANCE_M, LEAST_DISTANCE * float(max(size[0], size[2])) / 2)
    roomy = Framing((low + high) / 2, distance, ROOMY * float(size.max()))
    side, top, bottom = reach_of(gaussians, vertices, frames, roomy)
    target = roomy.target_m - np.array([0, (top + bottom) / 2, 0])
    return Framing(target, distance, max((bottom - top) / TALL, 2 * side / WIDE * height / width))


def reach_of(
    gaussians: Gaussians, vertices: Float[np.ndarray, "v 3"], frames: TriangleFrames, framing: Framing
) -> tuple[float, float, float]:
    """Give how far the avatar's head reaches in any camera of a rig: to a side, to the top (negative) and to the bottom.

    Returns:
        Lengths at the depth of the framing's target, metres.

    Raises:
        OptionError: nothing shows.
    """
    rasteriser = Rasteriser()
    middle, reaches = SIDE / 2, []
    for camera in framing.rig(SIDE, SIDE):
        shows = render_avatar(gaussians, frames, camera, rasteriser=rasteriser).alpha > SHOWS
        _, y, z = camera.rotation @ vertices.T.astype(np.float64) + camera.translation[:, None]
        bottom = float((camera.fy * y / z).max())  # of the mesh, from the middle
        rows = np.flatnonzero(shows[: int(middle + bottom) + 1].any(axis=1))
        if len(rows):
            of_head = shows[rows[0] : rows[0] + int(np.ceil(HEAD * (middle + bottom - rows[0])))]
            columns = np.flatnonzero(of_head.any(axis=0))
            reaches.append((max(middle - columns[0], columns[-1] + 1 - middle), middle - rows[0], bottom))
    if not reaches:
        raise OptionError("nothing of the avatar shows from any camera; there is nothing to film")
    side, top, bottom = np.array(reaches).max(axis=0) * framing.height_m / SIDE
    return float(side), -float(top), float(bottom)
