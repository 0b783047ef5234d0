"""Poses in which numbers are weighed and files are judged, and where cameras look then.

Source: own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import sigmoid, to_world
from sacha_core.avatar.motion import Motion
from sacha_core.errors import GeometryError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.synthesis.acting import act
from sacha_core.train.state import FITTED_MOTION

__all__ = ["Stance", "different_frames", "measuring_stances", "shown_motion", "stances_of", "stock_motion"]

MEASURING_FRAMES = 12
SHOWS = 0.1  # opacity of what counts for where the middle is
# stock poses by joints: jaw, and gaze down and to the subject's left, radians; then what is acted, and in how many moments
JOINTS_RAD = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.35, 0.0), (0.0, -0.35, 0.0), (0.0, 0.0, 0.4), (0.0, 0.0, -0.4))
ACTS = (("EXP-3", 9), ("EXP-5", 7))


@dataclass(frozen=True)
class Stance:
    """A posed head.

    Args:
        frames: of its triangles.
        target: what cameras look at, metres: the middle of the avatar, which goes where the head goes; the origin by default.
    """

    frames: TriangleFrames
    target: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def quaternions(self) -> Float[np.ndarray, "f 4"]:
        """Give the rotation of each triangle, wxyz."""
        return quaternion.from_matrix(self.frames.rotation)


def measuring_stances(avatar: Avatar, head: HeadModel, n_frames: int = MEASURING_FRAMES) -> tuple[Stance, ...]:
    """Give the poses in which numbers are weighed, far from one another: each differs most from those taken before.

    Args:
        avatar: with its motion, or without: then in stock expressions.
        head: the head that it is bound to.
        n_frames: how many.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    motion = shown_motion(avatar, head)
    return stances_of(avatar, head, motion, different_frames(motion, n_frames))


def stances_of(avatar: Avatar, head: HeadModel, motion: Motion, times: Sequence[int]) -> tuple[Stance, ...]:
    """Pose some frames of a motion.

    Args:
        avatar: whose Gaussians tell where the middle is.
        head: the head that it is bound to.
        motion: whose frames are posed.
        times: which of them.

    Raises:
        GeometryError, HeadError: as `measuring_stances`.
    """
    pose, stances = Poser(head, motion), list[Stance]()
    centre = pose.template.mean(axis=0, dtype=np.float64)
    for time in times:
        try:
            if not stances:
                middle = middle_of(avatar, triangle_frames(pose.template, head.faces))
            vertices = pose(time)
            frames = triangle_frames(vertices, head.faces)
        except GeometryError as error:
            raise GeometryError(f"frame {time} of the motion: {error}") from error
        stances.append(Stance(frames, middle + (vertices.mean(axis=0, dtype=np.float64) - centre)))
    return tuple(stances)


def middle_of(avatar: Avatar, rest: TriangleFrames) -> Float[np.ndarray, "3"]:
    """Give what cameras look at: on the axis of the head, half way up what shows of the resting avatar."""
    shows = sigmoid(avatar.gaussians.opacity_logit) > SHOWS
    means = to_world(avatar.gaussians.select(shows), rest).means if shows.any() else rest.origin
    return np.array([0.0, (float(means[:, 1].min()) + float(means[:, 1].max())) / 2, 0.0])


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


def shown_motion(avatar: Avatar, head: HeadModel) -> Motion:
    """Give an avatar's own motion, or stock expressions where it has none."""
    return avatar.motion if avatar.motion is not None and len(avatar.motion) else stock_motion(head)


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
