"""How far a decoded avatar is from the uncompressed one, by the views and poses that files are judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.model import HeadModel
from sacha_core.perception.psnr import psnr_over
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.curvature import draw
from sacha_core.rate.views import Shot, protocol_shots
from sacha_core.rate.world import in_world

__all__ = ["COVERED", "Judge"]

COVERED = 0.01  # alpha of pixels that are the avatar's own
QUICK_CAMERAS = 2  # of the sixteen, other ones for each pose
NOTHING_DB = 120.0  # where there is nothing to see

Truth = tuple[Bool[np.ndarray, "h w"], Float[np.ndarray, "h w 3"]]  # own pixels, and the picture


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
            Shot(shot.stance, tuple(shot.cameras[(3 * place + 8 * k) % 16] for k in range(QUICK_CAMERAS)))
            for place, shot in enumerate(self._shots)
        )
        self._kept: list[Truth] = []

    def quick(self, gaussians: Gaussians) -> float:
        """Give the PSNR over an eighth of the views, whose truth is drawn once."""
        if not self._kept:
            self._kept = [self._truth_of(shot, camera) for shot in self._quick_shots for camera in shot.cameras]
        return mean_of(self._ratios(gaussians, self._quick_shots, self._kept))

    def full(self, gaussians: Gaussians) -> float:
        """Give the PSNR over all 16 views of up to 12 poses."""
        ratios = []
        for shot in self._shots:
            truth = [self._truth_of(shot, camera) for camera in shot.cameras]
            ratios += self._ratios(gaussians, (shot,), truth)
        return mean_of(ratios)

    def _truth_of(self, shot: Shot, camera: Camera) -> Truth:
        frame = draw(self._truth, in_world(self._truth, shot.stance, self._rasteriser.pool), camera, self._rasteriser)
        return frame.transmittance < 1 - COVERED, frame.image.transpose(1, 2, 0).copy()

    def _ratios(self, gaussians: Gaussians, shots: Sequence[Shot], truth: Sequence[Truth]) -> list[float]:
        """Give the PSNR of each view in which there is something to see."""
        ratios, known = [], iter(truth)
        for shot in shots:
            world = in_world(gaussians, shot.stance, self._rasteriser.pool)
            for camera in shot.cameras:
                own, picture = next(known)
                if own.any():
                    found = draw(gaussians, world, camera, self._rasteriser).image.transpose(1, 2, 0)
                    ratios.append(psnr_over(found, picture, own))
        return ratios


def mean_of(ratios: Sequence[float]) -> float:
    """Give the mean of the decibels of views; those of no error where there is nothing to see."""
    return float(np.mean(ratios)) if ratios else NOTHING_DB
