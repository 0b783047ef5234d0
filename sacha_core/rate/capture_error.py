"""How far Gaussians are from pictures that were taken, not drawn.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import draw
from sacha_core.rate.squared_loss import squared_loss
from sacha_core.rate.stances import Stance
from sacha_core.rate.world import in_world
from sacha_core.train.views import Target

__all__ = ["capture_error"]

PICTURES = 24  # of those that there are


def capture_error(gaussians: Gaussians, motion: Motion, head: HeadModel, steps: Sequence[Sequence[Target]]) -> float:
    """Give the mean squared difference from some of the pictures, evenly spread.

    Args:
        gaussians: bound to the head.
        motion: that the targets' timesteps are of.
        head: the head model.
        steps: pictures, at least one.

    Raises:
        DatasetError: a picture cannot be decoded.
        GeometryError: a frame makes a triangle degenerate.
    """
    pose, rasteriser, errors = Poser(head, motion), Rasteriser(), list[float]()
    for place in np.unique(np.linspace(0, len(steps) - 1, PICTURES).astype(int)).tolist():
        target = steps[place][0]
        stance = Stance(triangle_frames(pose(target.timestep), head.faces))
        image = draw(gaussians, in_world(gaussians, stance, rasteriser.pool), target.camera, rasteriser).image
        errors.append(squared_loss(image, target.image).total)
    return float(np.mean(errors))
