"""A picture of an avatar: what everyone wants who does not train."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats

__all__ = ["Picture", "render_avatar"]


@dataclass(frozen=True)
class Picture:
    """An image and how much of each pixel is covered.

    Args:
        colour: (h, w, c) over the background; RGB may exceed 1 a little, as blended.
        alpha: (h, w) 0 to 1.
    """

    colour: Float[np.ndarray, "h w c"]
    alpha: Float[np.ndarray, "h w"]


def render_avatar(
    gaussians: Gaussians,
    frames: TriangleFrames,
    camera: Camera,
    background: float | Float[np.ndarray, " c"] = 1.0,
    sh_degree: int | None = None,
    colours: Float[np.ndarray, "n c"] | None = None,
    rasteriser: Rasteriser | None = None,
) -> Picture:
    """Draw an avatar in the pose of a mesh.

    Args:
        gaussians: n canonical Gaussians.
        frames: of each triangle of the posed head.
        camera: from where.
        background: what lies behind, one number for all channels or one for each.
        sh_degree: highest degree of the harmonics to use; None for all there are.
        colours: (n, c) one to four channels to draw instead of the Gaussians' own, such as `palette[labels[gaussians.binding]]` for
            regions.
        rasteriser: one to use again, whose memory and threads are there already; a new one by default.

    Raises:
        GeometryError: a Gaussian is bound to a triangle that has no frame.
        OptionError: `sh_degree` is more than the Gaussians have, or a shape is wrong.
        SachaError: a colour is not finite.
    """
    world = to_world(gaussians, frames)
    if colours is None:
        degree = gaussians.sh_degree if sh_degree is None else sh_degree
        colours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, world.means, camera.centre, degree)
    elif len(colours) != len(gaussians):
        raise OptionError(f"there are {len(colours)} colours for {len(gaussians)} Gaussians")
    rasteriser = rasteriser or Rasteriser()
    splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
    frame = rasteriser.forward(splats, camera, np.broadcast_to(background, splats.channels))
    return Picture(np.ascontiguousarray(frame.image.transpose(1, 2, 0)), 1 - frame.transmittance)
