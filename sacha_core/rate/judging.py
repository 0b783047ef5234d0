"""How far a decoded avatar is from the uncompressed one, by the views and poses that files are judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import draw
from sacha_core.rate.views import Shot, protocol_shots

__all__ = ["Judge"]

COVERED = 0.01  # alpha of pixels that are the avatar's own
QUICK_CAMERAS = 2  # of the sixteen, other ones for each pose
LEAST_ERROR = 1e-12  # mean squared: 120 dB

Truth = tuple[Bool[np.ndarray, "h w"], Float[np.ndarray, "m 3"]]  # own pixels, and their colours


class Judge:
    """Measures PSNR against the uncompressed avatar: of its own pixels, colours clipped to [0, 1], mean over views in decibels.

    Both are posed by the uncompressed motion, so that what the motion loses, which is bounded in metres, does not count.

    Args:
        avatar: uncompressed.
        head: the head that it is bound to.
        rasteriser: one to use again; a new one by default.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(self, avatar: Avatar, head: HeadModel, rasteriser: Rasteriser | None = None) -> None:
        self._truth, self._rasteriser = avatar.gaussians, rasteriser or Rasteriser()
        self._shots = protocol_shots(avatar, head)
        self._quick_shots = tuple(
            Shot(shot.frames, tuple(shot.cameras[(3 * place + 8 * k) % 16] for k in range(QUICK_CAMERAS)))
            for place, shot in enumerate(self._shots)
        )
        self._kept: list[Truth] = []

    def quick(self, gaussians: Gaussians) -> float:
        """Give the PSNR over an eighth of the views, whose truth is drawn once."""
        if not self._kept:
            self._kept = [self._truth_of(shot, camera) for shot in self._quick_shots for camera in shot.cameras]
        return mean_psnr(self._colours(gaussians, self._quick_shots, self._kept))

    def full(self, gaussians: Gaussians) -> float:
        """Give the PSNR over all 16 views of up to 12 poses."""
        errors = []
        for shot in self._shots:
            truth = [self._truth_of(shot, camera) for camera in shot.cameras]
            errors += self._colours(gaussians, (shot,), truth)
        return mean_psnr(errors)

    def _truth_of(self, shot: Shot, camera: Camera) -> Truth:
        frame = draw(self._truth, to_world(self._truth, shot.frames), camera, self._rasteriser)
        own = frame.transmittance < 1 - COVERED
        return own, np.clip(frame.image[:, own].T, 0, 1)

    def _colours(self, gaussians: Gaussians, shots: Sequence[Shot], truth: Sequence[Truth]) -> list[float]:
        """Give the mean squared error of each view in which there is something to see."""
        errors, known = [], iter(truth)
        for shot in shots:
            world = to_world(gaussians, shot.frames)
            for camera in shot.cameras:
                own, colours = next(known)
                found = np.clip(draw(gaussians, world, camera, self._rasteriser).image[:, own].T, 0, 1)
                if len(found):
                    errors.append(float(np.mean(np.square(found - colours), dtype=np.float64)))
        return errors


def mean_psnr(errors: Sequence[float]) -> float:
    """Give the mean of the decibels of views; those of no error where there is nothing to see."""
    return float(-10 * np.mean(np.log10(np.maximum(errors or [0.0], LEAST_ERROR))))
