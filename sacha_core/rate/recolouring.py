r"""Colours that make up for what the rest of a file lost: Gaussians that went, and coarser places, sizes and opacities.

Pictures are linear in the colours that Gaussians are seen in. So with all else as it will be decoded, the colours x whose pictures $A x$
come nearest to those of the uncompressed avatar solve a least-squares problem, of which a few steps of conjugate gradients find most: each
takes two walks over the views, one that draws and one that sums blending weights. A Gaussian that these views hardly show stays as it is.
Colours are coded after everything that they make up for, so nothing else in a file changes with them.

Source: Hestenes and Stiefel, 1952 (conjugate gradients), with the diagonal as preconditioner; otherwise own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import WorldGaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.parallel.pool import Pool
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.rate.curvature import draw
from sacha_core.rate.views import Shot
from sacha_core.rate.world import in_world

__all__ = ["Pictures", "Recolouring", "n_views", "views_of"]

STEPS = 2  # six take two per cent more of the bytes of an untrained avatar, and nothing of a trained one's
RIDGE, RIDGE_RANK = 0.25, 0.25  # share of the worth of colours of this rank: worth less, they stay near what they were
LEAST = 1e-30
BLACK = np.zeros(3, np.float32)

Picture = Float[np.ndarray, "3 h w"]
Colours = Float[np.ndarray, "n 3"]


class Pictures:
    """Pictures of the uncompressed avatar, drawn once they are asked for.

    Args:
        truth: its Gaussians.
        shots: poses and cameras to look from.
    """

    def __init__(self, truth: Gaussians, shots: Sequence[Shot]) -> None:
        self._truth, self.shots = truth, tuple(shots)
        self._drawn: list[Picture] = []

    def drawn(self, rasteriser: Rasteriser) -> list[Picture]:
        """Give them, pose after pose."""
        if not self._drawn:
            for world, camera in views_of(self._truth, self.shots, rasteriser.pool):
                self._drawn.append(draw(self._truth, world, camera, rasteriser).image.copy())
        return self._drawn


class Recolouring:
    """Fits the colours of what is left of an avatar to pictures of all of it.

    Args:
        pictures: of the uncompressed avatar.
        rasteriser: one to use again; a new one by default.
    """

    def __init__(self, pictures: Pictures, rasteriser: Rasteriser | None = None) -> None:
        self._pictures, self._rasteriser = pictures, rasteriser or Rasteriser()
        self._n_views = max(n_views(pictures.shots), 1)

    def __call__(self, decoded: Gaussians, worth: Float[np.ndarray, " n"]) -> Colours:
        """Give the coefficients of degree 0 with which pictures come near to the truth's.

        Args:
            decoded: n Gaussians that are left, in any order, as a decoder will have them but for their colours, where the search begins.
            worth: (n,) of a squared error of one such coefficient, as `GaussianImportance.sh_dc` has it.
        """
        seen = worth[worth > 0]
        if not len(seen):
            return decoded.sh_dc
        ridge = RIDGE * float(np.quantile(seen, RIDGE_RANK))
        scale = 1 / np.maximum(worth + ridge, LEAST)[:, None]
        found, left = decoded.sh_dc.astype(np.float64), -self._slope(decoded)
        near = scale * left
        towards, size = near, (left * near).sum(axis=0)
        for _ in range(STEPS):
            turned = self._normal(towards, decoded) + ridge * towards
            step = size / np.maximum((towards * turned).sum(axis=0), LEAST)
            found, left = found + step * towards, left - step * turned
            near = scale * left
            before, size = size, (left * near).sum(axis=0)
            towards = near + size / np.maximum(before, LEAST) * towards
        return found.astype(np.float32)

    def _slope(self, decoded: Gaussians) -> Colours:
        """Give half the gradient of the squared difference to the truth, mean over views; nothing where a colour was cut at black."""
        total = np.zeros((len(decoded), 3))
        for (world, camera), truth in zip(
            views_of(decoded, self._pictures.shots, self._rasteriser.pool),
            self._pictures.drawn(self._rasteriser),
            strict=True,
        ):
            frame = draw(decoded, world, camera, self._rasteriser)
            total += self._rasteriser.colour_weights(frame, frame.image - truth) * (frame.splats.colours > 0)
        return total * (BASIS[0] / self._n_views)

    def _normal(self, towards: Colours, decoded: Gaussians) -> Colours:
        """Give $A^T A$ times a direction, mean over views."""
        total, colours = np.zeros(towards.shape), (BASIS[0] * towards).astype(np.float32)
        for world, camera in views_of(decoded, self._pictures.shots, self._rasteriser.pool):
            splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
            frame = self._rasteriser.forward(splats, camera, BLACK)
            total += self._rasteriser.colour_weights(frame, frame.image)
        return total * (BASIS[0] / self._n_views)


def views_of(gaussians: Gaussians, shots: Sequence[Shot], pool: Pool) -> Iterator[tuple[WorldGaussians, Camera]]:
    """Go through all views, pose after pose; threads share out the carrying."""
    for shot in shots:
        world = in_world(gaussians, shot.stance, pool)
        for camera in shot.cameras:
            yield world, camera


def n_views(shots: Sequence[Shot]) -> int:
    """Give the number of pictures."""
    return sum(len(shot.cameras) for shot in shots)
