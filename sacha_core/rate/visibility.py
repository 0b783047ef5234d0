r"""Leaving out Gaussians that cost more bits than they are worth, the ones that nobody ever sees first of all.

What a picture changes by when a Gaussian is left out is known exactly (`Rasteriser.removal_changes`), but for one at a time: of two that
hide each other either may go, not both. So they go in rounds, the cheapest first, and what is left is measured anew. How far a Gaussian
may be seen and still go follows from the error that the level makes anyway. Nothing goes that stock expressions need more than that:
the inside of a mouth that stays shut in the motion at hand.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import draw
from sacha_core.rate.stances import Stance, measuring_stances, stock_motion
from sacha_core.rate.views import COARSE, Shot, spread_shots
from sacha_core.rate.world import in_world

__all__ = ["PRUNING_BITS", "Grounds", "grounds_for", "prune", "removal_errors"]

# A Gaussian that changes pictures by less than so many bits are worth goes. It costs some 30, but others lean on it: measured alone, it
# seems worth less than it is.
PRUNING_BITS = 4.0
ROUNDS = 6
CAMERAS, STOCK_CAMERAS, FINE_CAMERAS = 2, 1, 1  # a pose
STOCK_SHARE = 0.25  # of the weight: what only other expressions show counts a quarter


@dataclass(frozen=True)
class Grounds:
    """By which views is decided who may go.

    Args:
        own: of the avatar's motion.
        stock: of expressions that its motion may lack; none where it has no motion, and `own` are such.
        fine: of the avatar's motion at the resolution that files are judged at, twice that of the others.
    """

    own: tuple[Shot, ...]
    stock: tuple[Shot, ...]
    fine: tuple[Shot, ...]


def grounds_for(avatar: Avatar, head: HeadModel, stances: Sequence[Stance] | None = None) -> Grounds:
    """Choose the views to decide by.

    Args:
        avatar: about whose Gaussians is decided.
        head: the head that it is bound to.
        stances: of the avatar's motion, as `measuring_stances` gives them, which is the default.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    stances, stock = stances or measuring_stances(avatar, head), tuple[Shot, ...]()
    if avatar.motion is not None and len(avatar.motion):
        playing = replace(avatar, motion=stock_motion(head, avatar.motion))
        stock = spread_shots(measuring_stances(playing, head), STOCK_CAMERAS, COARSE)
    return Grounds(spread_shots(stances, CAMERAS, COARSE), stock, spread_shots(stances, FINE_CAMERAS))


def removal_errors(
    gaussians: Gaussians, shots: Sequence[Shot], rasteriser: Rasteriser | None = None
) -> Float[np.ndarray, " n"]:
    """Give the squared change of pictures when each Gaussian alone is left out: summed over pixels and channels, mean over views."""
    rasteriser, total = rasteriser or Rasteriser(), np.zeros(len(gaussians))
    for shot in shots:
        world = in_world(gaussians, shot.stance, rasteriser.pool)
        for camera in shot.cameras:
            frame = draw(gaussians, world, camera, rasteriser)
            ones = np.ones((1, *frame.transmittance.shape), np.float32)
            total += rasteriser.removal_changes(frame, ones).squared[:, 0]
    return total / max(sum(len(shot.cameras) for shot in shots), 1)


def prune(
    gaussians: Gaussians,
    shots: Sequence[Shot],
    elsewhere: Float[np.ndarray, " n"],
    least: float,
    rasteriser: Rasteriser | None = None,
    factors: Float[np.ndarray, " n"] | None = None,
    rounds: int = ROUNDS,
) -> Int[np.ndarray, " m"]:
    """Give the rows of the Gaussians that are worth their bits.

    Args:
        gaussians: n of them.
        shots: the views to decide by.
        elsewhere: (n,) what other views would change by without each, which counts where it is more.
        least: what a Gaussian has to change pictures by: squared, summed over pixels and channels, mean over views; 0 keeps all.
        rasteriser: one to use again; a new one by default.
        factors: (n,) how many times as much the change by each counts; once by default.
        rounds: in how many steps, each twice the last one's, they go.
    """
    rasteriser, rows = rasteriser or Rasteriser(), np.arange(len(gaussians))
    factors = np.ones(len(gaussians)) if factors is None else factors
    if least <= 0 or not len(gaussians):
        return rows
    for left in range(rounds - 1, -1, -1):
        taken = shots if left == 0 else every_other(shots, left)
        worth = np.maximum(removal_errors(gaussians.select(rows), taken, rasteriser), elsewhere[rows])
        rows = rows[worth * factors[rows] >= least / 2**left]
    return rows


def every_other(shots: Sequence[Shot], first: int) -> tuple[Shot, ...]:
    """Give half the views, of every pose."""
    return tuple(Shot(shot.stance, shot.cameras[(first + place) % 2 :: 2]) for place, shot in enumerate(shots))
