"""A short sequence to be coded both ways: some frames of an avatar, and the splats that stand for each frame alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sacha_core.animation.splat_binding import nearest_binding
from sacha_core.animation.standing import standing_on
from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.bench.preset import Subject
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers.peer import visible
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.interchange.capture import Capture
from sacha_core.perception.psnr import psnr, psnr_over
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.rate.judging import COVERED
from sacha_core.rate.stances import stances_of
from sacha_core.rate.views import PROTOCOL_VIEWS, Shot, ring_shots
from sacha_core.train.static import WORLD_FRAMES

__all__ = ["POSED", "TRAINED", "Clip", "Played", "captured_psnr", "make_clip", "picture_psnr"]

POSED, TRAINED = "posed", "trained"
EVERY_CAMERA = 5  # of the protocol


@dataclass(frozen=True)
class Played:
    """Frames as they are drawn: Gaussians, and the triangles that carry them.

    Args:
        gaussians: (t) of each frame.
        poses: (t) frames of the triangles.
    """

    gaussians: Sequence[Gaussians]
    poses: Sequence[TriangleFrames]

    @classmethod
    def in_the_world(cls, splats: Sequence[Gaussians]) -> Played:
        """Give frames of splats that stand in the world."""
        unbound = [replace(one, binding=np.zeros_like(one.binding)) for one in splats]
        return cls(unbound, [WORLD_FRAMES] * len(unbound))


@dataclass(frozen=True)
class Clip:
    """Some frames of a motion.

    Args:
        avatar: with these frames as its motion.
        times: which frames of the whole motion they are.
        shots: each posed, and the cameras that look at it.
        splats: (t) splats in the world for each frame, each with the triangle that it is at: those of the posed avatar and, where there
            are some, those that were trained for the frame.
    """

    avatar: Avatar
    times: tuple[int, ...]
    shots: tuple[Shot, ...]
    splats: Mapping[str, list[Gaussians]]

    def uncompressed(self, source: str) -> Played:
        """Give what the sequence looks like before it is coded."""
        if source == TRAINED:
            return Played.in_the_world(self.splats[TRAINED])
        return Played([self.avatar.gaussians] * len(self.times), [shot.frames for shot in self.shots])


def make_clip(subject: Subject, count: int, scale: float, trained: Mapping[int, Gaussians]) -> Clip:
    """Cut frames from the middle of the motion, or those that splats were trained for, and pose the avatar.

    Args:
        subject: the avatar.
        count: how many frames at most.
        scale: of the pictures' sides.
        trained: splats by the frame of the motion that they were trained for, in the world; none for none.

    Raises:
        OptionError: the motion has no such frame.
    """
    motion = subject.avatar.motion
    assert motion is not None
    first = max((len(motion) - count) // 2, 0)
    times = sorted(trained)[:count] or list(range(first, min(first + count, len(motion))))
    if times[-1] >= len(motion):
        raise OptionError(
            f"there are splats of frame {times[-1]}; the motion of {subject.path} has frames 0 to {len(motion) - 1}"
        )
    short = motion.frames(np.array(times))
    stances = stances_of(subject.avatar, subject.head, short, range(len(short)))
    shots = ring_shots(stances, PROTOCOL_VIEWS[::EVERY_CAMERA], scale)
    seen = visible(subject.avatar.gaussians)
    splats = {POSED: [standing_on(seen, shot.frames) for shot in shots]}
    if trained:
        pose, faces = Poser(subject.head, short), subject.head.faces
        splats[TRAINED] = [at_triangles(visible(trained[time]), pose(place), faces) for place, time in enumerate(times)]
    return Clip(replace(subject.avatar, motion=short), tuple(times), shots, splats)


def at_triangles(splats: Gaussians, vertices: np.ndarray, faces: np.ndarray) -> Gaussians:
    """Say of each splat in the world which triangle of the posed head it is at; encoders find good orders by it."""
    binding, _ = nearest_binding(splats.position, vertices, faces)
    return replace(splats, binding=binding.astype(np.int32))


def picture_psnr(clip: Clip, before: Played, after: Played, rasteriser: Rasteriser) -> float:
    """Give PSNR of coded against uncompressed, over the pixels that the uncompressed frame covers, mean of all pictures, decibels."""
    ratios = []
    for frame in range(len(after.gaussians)):
        for camera in clip.shots[frame].cameras:
            drawn = render_avatar(before.gaussians[frame], before.poses[frame], camera, rasteriser=rasteriser)
            back = render_avatar(after.gaussians[frame], after.poses[frame], camera, rasteriser=rasteriser)
            ratios.append(psnr_over(back.colour, drawn.colour, drawn.alpha > COVERED))
    return float(np.mean(ratios))


def captured_psnr(clip: Clip, capture: Capture, shown: Played, rasteriser: Rasteriser) -> float | None:
    """Give PSNR against what the held-out cameras of a capture saw, whole pictures, mean, decibels; None where they saw no such frame."""
    ratios = []
    for frame, time in enumerate(clip.times[: len(shown.gaussians)]):
        for view in capture.val:
            if view.timestep == time:
                truth = capture.image(view)
                drawn = render_avatar(shown.gaussians[frame], shown.poses[frame], view.camera, rasteriser=rasteriser)
                ratios.append(psnr(drawn.colour, truth))
    return float(np.mean(ratios)) if ratios else None
