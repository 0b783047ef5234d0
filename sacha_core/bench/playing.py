"""One way to play an avatar, timed frame by frame and held against the plain way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from sacha_core.animation.player import Player, PlayOptions
from sacha_core.bench.clock import Clock, Times
from sacha_core.bench.scenes import front_camera
from sacha_core.codec import decode
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

__all__ = ["Case", "Played", "differences"]

ORBIT_DEG = 1.0  # that a moving camera travels in a frame: once round in 15 s at 25 frames a second
SWEEP_DEG = 40.0  # to each side
CHECKED_FRAMES = 3
RARE = 0.999
Moves = Literal["motion", "camera", "both", "nothing"]


@dataclass(frozen=True)
class Case:
    """What is played and how.

    Args:
        name: what sets it apart.
        n: Gaussians of the avatar.
        width: of the picture, pixels.
        height: likewise.
        degree: of the harmonics in use.
        moves: what changes from frame to frame.
        options: how it is drawn.
    """

    name: str
    n: int
    width: int
    height: int
    degree: int
    moves: Moves
    options: PlayOptions

    def moment(self, step: int, n_frames: int) -> tuple[int, Camera]:
        """Give frame and camera of a step."""
        frame = step % n_frames if self.moves in {"motion", "both"} else 0
        turn = 0.0
        if self.moves in {"camera", "both"}:  # there and back again, without a jump
            turn = SWEEP_DEG - abs((step * ORBIT_DEG) % (4 * SWEEP_DEG) - 2 * SWEEP_DEG)
        return frame, orbited(front_camera(self.width, self.height), turn)


def orbited(camera: Camera, degrees: float) -> Camera:
    """Give a camera that has travelled round the world's y axis."""
    if degrees == 0:
        return camera
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return Camera(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.rotation @ turn.T, camera.translation
    )  # fmt: skip


class Played:
    """Plays a case on and on, and keeps the time that each frame took.

    Args:
        case: what to play and how.
        player: opened on it.
        run: frames that one call plays.
    """

    def __init__(self, case: Case, player: Player, run: int) -> None:
        self.case, self._player, self._run = case, player, run
        self._clock, self._step = Clock(), 0
        self._frames: list[tuple[float, float]] = []

    def __call__(self) -> None:
        """Play some frames more."""
        for _ in range(self._run):
            frame, camera = self.case.moment(self._step, len(self._player))
            wall, busy = self._clock.wall(), self._clock.busy()
            self._player.frame(frame, camera)
            self._frames.append((self._clock.wall() - wall, self._clock.busy() - busy))
            self._step += 1

    def forget(self) -> None:
        """Forget the times so far, which were the warm-up's."""
        self._frames.clear()

    def close(self) -> None:
        """Close the player."""
        self._player.close()

    @property
    def times(self) -> Times:
        """Of each frame."""
        return Times(*np.array(self._frames).T)


def differences(case: Case, data: bytes, head: HeadModel, run: int) -> Float[np.ndarray, " m"]:
    """Give how far pictures of a case are from those of the plain way: all frames decoded, posed by NumPy, nothing left out.

    The frames are played in order, so that what is used again from frame to frame has its effect; three of them are looked at.

    Args:
        case: what to play and how; its pictures are taken before they are rounded to bytes.
        data: of the file.
        head: that it is bound to.
        run: frames to play.

    Returns:
        Absolute differences of all pixels and channels of the frames that were looked at, of a range of 0 to 1.
    """
    avatar = decode(data, head=head)
    assert avatar.motion is not None
    pose, rasteriser = Poser(head, avatar.motion), Rasteriser(case.options.threads)
    looked_at = set(np.linspace(1, run - 1, CHECKED_FRAMES).astype(int).tolist())  # nothing is kept at the first
    options = PlayOptions(
        case.options.threads, np.float32, case.options.background, case.options.sh_degree, case.options.crop,
        case.options.colour_turn_deg,
    )  # fmt: skip
    found = []
    with Player.open(data, head, options) as player:
        for step in range(run):
            frame, camera = case.moment(step, len(player))
            picture = player.frame(frame, camera)
            if step in looked_at:
                frames = triangle_frames(pose(frame), head.faces)
                plain = render_avatar(avatar.gaussians, frames, camera, rasteriser=rasteriser)
                found.append(np.abs(picture - plain.colour).ravel())
    return np.concatenate(found)
