"""Where an avatar is looked at when its numbers are weighed: in its own motion, and in stock expressions where it has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import sigmoid, to_world
from sacha_core.avatar.motion import Motion
from sacha_core.errors import GeometryError, OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.synthesis.acting import act
from sacha_core.train.state import FITTED_MOTION

__all__ = [
    "ELEVATIONS_DEG",
    "PROTOCOL_VIEWS",
    "Shot",
    "different_frames",
    "measuring_shots",
    "placed",
    "protocol_shots",
    "ring_shots",
    "spread_shots",
    "stock_motion",
]

AZIMUTHS_DEG = tuple(float(azimuth) for azimuth in np.linspace(-75, 75, 8))
ELEVATIONS_DEG = (-8.0, 14.0)
PROTOCOL_VIEWS = tuple((azimuth, elevation) for elevation in ELEVATIONS_DEG for azimuth in AZIMUTHS_DEG)
DISTANCE_M, FOCAL_PIXELS, WIDTH, HEIGHT = 1.0, 1500.0, 550, 802  # the head fills two thirds of the picture's height
REACH_DEG, BEHIND = 80.0, 6  # of the cameras that weigh numbers: to either side, and every which one looks from behind
SHOWS = 0.1  # opacity of what counts for where the middle is
# stock poses by joints: jaw, and gaze down and to the subject's left, radians; then what is acted, and in how many moments
JOINTS_RAD = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.35, 0.0), (0.0, -0.35, 0.0), (0.0, 0.0, 0.4), (0.0, 0.0, -0.4))
ACTS = (("EXP-3", 9), ("EXP-5", 7))


@dataclass(frozen=True)
class Shot:
    """A pose and the cameras that look at it.

    Args:
        frames: of the posed head's triangles.
        cameras: from where.
    """

    frames: TriangleFrames
    cameras: tuple[Camera, ...]

    @cached_property
    def quaternions(self) -> Float[np.ndarray, "f 4"]:
        """Give the rotation of each triangle, wxyz."""
        return quaternion.from_matrix(self.frames.rotation)


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
    motion = avatar.motion if avatar.motion is not None and len(avatar.motion) else stock_motion(head)
    times = np.unique(np.round(np.linspace(0, len(motion) - 1, n_frames)).astype(int))
    return ring_shots(avatar, head, motion, times.tolist(), PROTOCOL_VIEWS, share)


def measuring_shots(
    avatar: Avatar, head: HeadModel, n_cameras: int, n_frames: int = 12, share: float = 0.5
) -> tuple[Shot, ...]:
    """Give views by which numbers are weighed: other cameras for each pose, spread over the front, every sixth behind.

    Poses lie far from one another: each is the one that differs most from those taken before.

    Args:
        avatar: as there.
        head: likewise.
        n_cameras: for each pose.
        n_frames: poses.
        share: of the resolution of `protocol_shots`.
    """
    motion = avatar.motion if avatar.motion is not None and len(avatar.motion) else stock_motion(head)
    return spread_shots(avatar, head, motion, different_frames(motion, n_frames), n_cameras, share)


def spread_shots(
    avatar: Avatar, head: HeadModel, motion: Motion, times: Sequence[int], n_cameras: int, share: float = 1.0
) -> tuple[Shot, ...]:
    """Give views of frames of a motion: other cameras for each, as in `measuring_shots`.

    Args:
        avatar: whose Gaussians tell where the middle is.
        head: the head that it is bound to.
        motion: whose frames are posed.
        times: which of them.
        n_cameras: for each.
        share: of the resolution of `protocol_shots`.
    """
    views = [azimuth_and_elevation(view) for view in range(len(times) * n_cameras)]
    each = [views[place * n_cameras : (place + 1) * n_cameras] for place in range(len(times))]
    return shots_of(avatar, head, motion, times, each, share)


def azimuth_and_elevation(view: int) -> tuple[float, float]:
    """Give the direction of one of any number of views, evenly spread (golden and plastic ratio)."""
    across, up = (view * 0.6180339887 + 0.5) % 1, (view * 0.7548776662 + 0.5) % 1
    azimuth = REACH_DEG * (2 * across - 1)
    if view % BEHIND == BEHIND - 1:
        azimuth += 180
    return azimuth, ELEVATIONS_DEG[0] + up * (ELEVATIONS_DEG[1] - ELEVATIONS_DEG[0])


def different_frames(motion: Motion, n: int) -> list[int]:
    """Give up to `n` frames, each the one whose parameters differ most from all before; the first is nearest to the mean."""
    rows = np.concatenate([motion.expression, motion.jaw, motion.neck, motion.rotation, motion.eyes], axis=1)
    rows = rows.astype(np.float64)
    frames = [int(np.argmin(((rows - rows.mean(axis=0)) ** 2).sum(axis=1)))]
    distance = np.full(len(rows), np.inf)
    for _ in range(min(n, len(rows)) - 1):
        distance = np.minimum(distance, ((rows - rows[frames[-1]]) ** 2).sum(axis=1))
        frames.append(int(np.argmax(distance)))
    return frames


def ring_shots(
    avatar: Avatar,
    head: HeadModel,
    motion: Motion,
    times: Sequence[int],
    views: Sequence[tuple[float, float]],
    share: float = 1.0,
) -> tuple[Shot, ...]:
    """Give views of frames of a motion from a ring of cameras.

    Args:
        avatar: as in `spread_shots`.
        head: likewise.
        motion: likewise.
        times: likewise.
        views: azimuth (0 in front, 90 at the subject's left) and elevation of each camera, degrees.
        share: of the pictures' resolution.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
        OptionError: the share is none.
    """
    if not 0 < share <= 1:
        raise OptionError(f"the share of the resolution is {share:g}, expected above 0 and at most 1")
    return shots_of(avatar, head, motion, times, [views] * len(times), share)


def shots_of(
    avatar: Avatar,
    head: HeadModel,
    motion: Motion,
    times: Sequence[int],
    views: Sequence[Sequence[tuple[float, float]]],
    share: float,
) -> tuple[Shot, ...]:
    """Pose frames and set up the cameras of each, which go where the head goes."""
    pose, shots = Poser(head, motion), list[Shot]()
    centre = pose.template.mean(axis=0, dtype=np.float64)
    for time, mine in zip(times, views, strict=True):
        try:
            if not shots:
                middle = middle_of(avatar, triangle_frames(pose.template, head.faces))
            vertices = pose(time)
            frames = triangle_frames(vertices, head.faces)
        except GeometryError as error:
            raise GeometryError(f"frame {time} of the motion: {error}") from error
        target = middle + (vertices.mean(axis=0, dtype=np.float64) - centre)
        shots.append(Shot(frames, tuple(placed(target, *view, share) for view in mine)))
    return tuple(shots)


def middle_of(avatar: Avatar, rest: TriangleFrames) -> Float[np.ndarray, "3"]:
    """Give what cameras look at: on the axis of the head, half way up what shows of the resting avatar."""
    shows = sigmoid(avatar.gaussians.opacity_logit) > SHOWS
    means = to_world(avatar.gaussians.select(shows), rest).means if shows.any() else rest.origin
    return np.array([0.0, (float(means[:, 1].min()) + float(means[:, 1].max())) / 2, 0.0])


def placed(target: Float[np.ndarray, "3"], azimuth_deg: float, elevation_deg: float, share: float) -> Camera:
    """Give a camera of the ring."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    away = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    full = Camera.look_at(target + DISTANCE_M * away, target, WIDTH, HEIGHT, FOCAL_PIXELS)
    return full if share == 1 else full.resized(max(round(WIDTH * share), 1), max(round(HEIGHT * share), 1))


def stock_motion(head: HeadModel, person: Motion | None = None) -> Motion:
    """Give poses that show what a motion at hand may hide: jaw open, gaze to all sides, and what the head does when it acts.

    Acting sets ARKit's and the synthetic head's components by name, so that lids close and lips part; nameless ones vary by chance.

    Args:
        head: what is moved; joints that it lacks are ignored.
        person: whose identity and offsets are taken; the mean head's by default.
    """
    played = [act(head, name, n, 0) for name, n in ACTS]
    motion = Motion.rest(0, head.exprdirs.shape[2], len(JOINTS_RAD))
    for row, (jaw, *gaze) in enumerate(JOINTS_RAD):
        motion.jaw[row, 0] = jaw
        motion.eyes[row] = (*gaze, 0, *gaze, 0)
    parts = [motion, *played]
    person = motion if person is None else person
    dynamic: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in FITTED_MOTION}
    return replace(motion, shape=person.shape, static_offset=person.static_offset, **dynamic)
