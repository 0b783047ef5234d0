"""Which Gaussians ever show: those with a blending weight worth a few pixels over the views that they were fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.evaluate.splits import spread
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import View
from sacha_core.raster.rasteriser import Rasteriser, Splats

__all__ = ["MIN_WEIGHT", "VIEWS", "visible_gaussians"]

MIN_WEIGHT = 10.0  # pixels' worth of blending weight, summed over the views
VIEWS = 120


def visible_gaussians(
    gaussians: Gaussians,
    head: HeadModel,
    motion: Motion,
    views: Sequence[View],
    width: int,
    height: int,
    rasteriser: Rasteriser | None = None,
) -> Bool[np.ndarray, " n"]:
    """Find the Gaussians that some of the views really show.

    Args:
        gaussians: the avatar's.
        head: the head that they are bound to.
        motion: frame t is the views' timestep t.
        views: where to look from, training views as a rule; at most `VIEWS` of them are drawn, evenly spread.
        width: pixels.
        height: pixels.
        rasteriser: one to use again; a new one by default.

    Returns:
        (n,) True where the blending weights over all pixels of those views sum to at least `MIN_WEIGHT`.
    """
    rasteriser = rasteriser or Rasteriser()
    pose = Poser(head, motion)
    total = np.zeros(len(gaussians))
    ones = np.ones((1, height, width), np.float32)
    colours = np.zeros((len(gaussians), 1), np.float32)
    for view in spread(views, VIEWS):
        world = to_world(gaussians, triangle_frames(pose(view.timestep), head.faces))
        splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
        frame = rasteriser.forward(splats, view.camera.resized(width, height), np.zeros(1, np.float32))
        total += rasteriser.colour_weights(frame, ones)[:, 0]
    visible: np.ndarray = total >= MIN_WEIGHT
    return visible
