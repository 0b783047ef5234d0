"""Displacement fields over the head, written as tables of soft pushes; blend shapes are made of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.anatomy import MIRROR, Anatomy
from sacha_core.flame.synthetic.eyes import EYE_CENTRE, EYE_RADIUS
from sacha_core.flame.synthetic.skinning import below_mouth
from sacha_core.flame.synthetic.spline import bump, smooth_step

__all__ = ["Push", "eye_nearness", "push_field"]

# Up to the first distance from the middle of an eye (in its radii) everything goes with the eyeball; past the second nothing does.
EYE_NEAR, EYE_FAR = 1.25, 2.5


@dataclass(frozen=True)
class Push:
    """A soft push: a Gaussian of height `by` about `at`.

    Args:
        at: centre, metres.
        radius: standard deviation along each axis, metres.
        by: displacement in the middle, metres.
        side: `both` adds the mirror image, `one` does not.
        lip: whether it takes hold of everything or only of what lies above or below the slit of the mouth.
    """

    at: tuple[float, float, float]
    radius: tuple[float, float, float]
    by: tuple[float, float, float]
    side: Literal["one", "both"] = "one"
    lip: Literal["all", "upper", "lower"] = "all"

    def mirrored(self) -> Push:
        """Give the same push on the other side of the head."""
        (x, y, z), (dx, dy, dz) = self.at, self.by
        return Push((-x, y, z), self.radius, (-dx, dy, dz), self.side, self.lip)


def push_field(points: Float[np.ndarray, "n 3"], pushes: Iterable[Push]) -> Float[np.ndarray, "n 3"]:
    """Sum pushes at points of the mean head.

    Args:
        points: (n, 3) metres.
        pushes: the pushes.

    Returns:
        (n, 3) displacement, metres.

    Source: own.
    """
    moved = np.zeros_like(points)
    for push in pushes:
        for one in (push, push.mirrored()) if push.side == "both" else (push,):
            height = bump(points, one.at, one.radius)
            if one.lip != "all":
                lower = below_mouth(points)
                height = height * (lower if one.lip == "lower" else 1 - lower)
            moved += height[:, None] * np.asarray(one.by)
    return moved


def eye_nearness(anatomy: Anatomy) -> Float[np.ndarray, "2 v"]:
    """How far each vertex belongs to the left and to the right eye: 1 at the eyeball and its lids, 0 from the brow on."""
    near = []
    for centre in (np.asarray(EYE_CENTRE), np.asarray(EYE_CENTRE) * MIRROR):
        distance = np.linalg.norm(anatomy.vertices - centre, axis=1)
        near.append(smooth_step(distance, EYE_FAR * EYE_RADIUS, EYE_NEAR * EYE_RADIUS))
    return np.array(near)
