"""Where an avatar is looked at when its numbers are weighed: in its own motion, and in stock expressions where it has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.raster.camera import Camera
from sacha_core.rate.stances import Stance, shown_motion, stances_of

__all__ = [
    "COARSE",
    "ELEVATIONS_DEG",
    "PROTOCOL_VIEWS",
    "Shot",
    "placed",
    "protocol_shots",
    "ring_shots",
    "spread_shots",
]

AZIMUTHS_DEG = tuple(float(azimuth) for azimuth in np.linspace(-75, 75, 8))
ELEVATIONS_DEG = (-8.0, 14.0)
PROTOCOL_VIEWS = tuple((azimuth, elevation) for elevation in ELEVATIONS_DEG for azimuth in AZIMUTHS_DEG)
DISTANCE_M, FOCAL_PIXELS, WIDTH, HEIGHT = 1.0, 1500.0, 550, 802  # the head fills two thirds of the picture's height
REACH_DEG, BEHIND = 80.0, 6  # of the cameras that weigh numbers: to either side, and every which one looks from behind
COARSE = 0.5  # share of the resolution that files are judged at: enough for most of what is measured


@dataclass(frozen=True)
class Shot:
    """A pose and the cameras that look at it.

    Args:
        stance: the pose.
        cameras: from where.
    """

    stance: Stance
    cameras: tuple[Camera, ...]

    @property
    def frames(self) -> TriangleFrames:
        """Give those of the posed head's triangles."""
        return self.stance.frames


def protocol_shots(avatar: Avatar, head: HeadModel, n_frames: int = 12, share: float = 1.0) -> tuple[Shot, ...]:
    """Give the views by which files are judged: frames spread over the motion, sixteen cameras each, 550 x 802 pixels.

    Cameras stand 1 m from the middle of the resting avatar, and go where the head goes.

    Args:
        avatar: with its motion, or without: then in stock expressions.
        head: the head that it is bound to.
        n_frames: of the motion, evenly spread; all where there are fewer.
        share: of the pictures' resolution.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    motion = shown_motion(avatar, head)
    times = np.unique(np.round(np.linspace(0, len(motion) - 1, n_frames)).astype(int))
    return ring_shots(stances_of(avatar, head, motion, times.tolist()), PROTOCOL_VIEWS, share)


def spread_shots(stances: Sequence[Stance], n_cameras: int, share: float = 1.0) -> tuple[Shot, ...]:
    """Give other views for each pose, spread over the front, every sixth behind.

    Args:
        stances: the poses.
        n_cameras: for each.
        share: of the resolution of `protocol_shots`.
    """
    return tuple(
        Shot(stance, tuple(placed(stance.target, *spread(place * n_cameras + k), share) for k in range(n_cameras)))
        for place, stance in enumerate(stances)
    )


def spread(view: int) -> tuple[float, float]:
    """Give azimuth and elevation of one of any number of views, evenly spread (golden and plastic ratio)."""
    across, up = (view * 0.6180339887 + 0.5) % 1, (view * 0.7548776662 + 0.5) % 1
    azimuth = REACH_DEG * (2 * across - 1)
    if view % BEHIND == BEHIND - 1:
        azimuth += 180
    return azimuth, ELEVATIONS_DEG[0] + up * (ELEVATIONS_DEG[1] - ELEVATIONS_DEG[0])


def ring_shots(stances: Sequence[Stance], views: Sequence[tuple[float, float]], share: float = 1.0) -> tuple[Shot, ...]:
    """Give the same views for each pose, from a ring of cameras.

    Args:
        stances: the poses.
        views: azimuth (0 in front, 90 at the subject's left) and elevation of each camera, degrees.
        share: of the pictures' resolution.

    Raises:
        OptionError: the share is none.
    """
    if not 0 < share <= 1:
        raise OptionError(f"the share of the resolution is {share:g}, expected above 0 and at most 1")
    return tuple(Shot(stance, tuple(placed(stance.target, *view, share) for view in views)) for stance in stances)


def placed(target: Float[np.ndarray, "3"], azimuth_deg: float, elevation_deg: float, share: float) -> Camera:
    """Give a camera of the ring."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    away = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    full = Camera.look_at(target + DISTANCE_M * away, target, WIDTH, HEIGHT, FOCAL_PIXELS)
    return full if share == 1 else full.resized(max(round(WIDTH * share), 1), max(round(HEIGHT * share), 1))
