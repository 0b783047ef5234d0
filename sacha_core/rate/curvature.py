r"""What every number of an avatar is worth to pictures, measured by rendering.

A picture's change by a small change of the numbers is J times that. To push a picture e of random signs back through the rasteriser gives
$g = J^T e$, and since the signs of any two pixels agree as often as not, the mean of $g_i^2$ is $(J^T J)_{ii}$: one backward pass a view
gives an estimate of all of them at once. Many views of several poses average its noise away.

Source: Hutchinson's estimator for the diagonal of a Gauss-Newton matrix (Bekas, Kokiopoulou and Saad, 2007).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import WorldGaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.importance import GaussianImportance
from sacha_core.flame.model import HeadModel
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours, share
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.rate.kernels.sums import add_outer_products, add_view, mirror
from sacha_core.rate.stances import Stance, measuring_stances
from sacha_core.rate.views import COARSE, Shot, spread_shots
from sacha_core.rate.world import in_world

__all__ = ["draw", "importance_of", "measure_importance"]

WHITE = np.ones(3, np.float32)
CAMERAS, DIRECTIONAL_CAMERAS = 2, 4  # a pose; a colour that depends on the direction wants to be seen from more of them
SUMMED = ("position", "log_scale", "rotation", "opacity", "sh_dc")


def importance_of(
    avatar: Avatar,
    head: HeadModel,
    seed: int = 0,
    rasteriser: Rasteriser | None = None,
    stances: Sequence[Stance] | None = None,
) -> GaussianImportance:
    """Measure what every number of an avatar is worth, in its own motion, at half the resolution of `protocol_shots`.

    Takes about a second on one core for 20,000 Gaussians.

    Args:
        avatar: to be weighed.
        head: the head that it is bound to.
        seed: of the random signs.
        rasteriser: one to use again; a new one by default.
        stances: of the avatar's motion, as `measuring_stances` gives them, which is the default.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    n_cameras = DIRECTIONAL_CAMERAS if avatar.gaussians.sh_degree else CAMERAS
    shots = spread_shots(stances or measuring_stances(avatar, head), n_cameras, COARSE)
    return measure_importance(avatar.gaussians, shots, seed, rasteriser)


def measure_importance(
    gaussians: Gaussians, shots: Sequence[Shot], seed: int = 0, rasteriser: Rasteriser | None = None
) -> GaussianImportance:
    """Measure what every number of every Gaussian is worth, mean over views.

    Args:
        gaussians: n of them.
        shots: poses and cameras; pictures of lower resolution than those that count give less in proportion to their pixels.
        seed: of the random signs.
        rasteriser: one to use again; a new one by default.

    Returns:
        An unbiased estimate. Results are the same bytes for any number of threads.
    """
    rasteriser, rng = rasteriser or Rasteriser(), np.random.default_rng(seed)
    n, k, views = len(gaussians), gaussians.sh_rest.shape[1], max(sum(len(shot.cameras) for shot in shots), 1)
    sums = {name: np.zeros((n, 3) if name != "opacity" else n) for name in SUMMED}
    metric, spaces = np.zeros((n, k + 1, k + 1), np.float32), Spaces.of(n)
    for shot in shots:
        world = in_world(gaussians, shot.stance, rasteriser.pool)
        columns = np.empty((n, len(shot.cameras), k + 1), np.float32)
        for view, camera in enumerate(shot.cameras):
            frame = draw(gaussians, world, camera, rasteriser, spaces)
            signs = rng.integers(0, 2, frame.image.shape, np.int8)
            slopes = rasteriser.backward(frame, (2 * signs - 1).astype(np.float32))
            centre, frames = np.asarray(camera.centre, np.float32), shot.frames
            arguments = (
                (world.means, world.scales, world.quaternions, world.opacities), (gaussians.binding, frames.rotation, frames.scale),
                (slopes.means, slopes.scales, slopes.quaternions, slopes.opacities, slopes.colours),
                spaces.colours, spaces.tilts, (spaces.cut, spaces.weights), tuple(sums.values()), columns, view, centre,
                gaussians.sh_degree,
            )  # fmt: skip
            share(rasteriser.pool, n, partial(call, add_view, arguments))
        share(rasteriser.pool, n, partial(call, add_outer_products, (metric, columns)))
    share(rasteriser.pool, n, partial(call, mirror, (metric, np.float32(1 / views))))
    diagonal = np.diagonal(metric[:, 1:, 1:], axis1=1, axis2=2)
    rest = np.repeat(diagonal[:, :, None], 3, axis=2).astype(np.float64)
    means = {name: total / views for name, total in sums.items()}
    return GaussianImportance(**means, sh_rest=rest, colour_metric=metric)


def call(kernel: Callable[..., None], arguments: tuple[Any, ...], start: int, stop: int) -> None:
    """Let a kernel do a range of rows."""
    kernel(start, stop, *arguments)


@dataclass(frozen=True)
class Spaces:
    """Memory that views are looked at in, one after the other.

    Args:
        colours: (n, 3) as drawn.
        tilts: (3, n, 3) their gradients by the mean.
        cut: (n, 3) gradients by the colours where those were not cut at black.
        weights: (n, 3) of the colours, alike.
    """

    colours: Float[np.ndarray, "n 3"]
    tilts: Float[np.ndarray, "3 n 3"]
    cut: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n 3"]

    @classmethod
    def of(cls, n: int) -> Spaces:
        """Make some for n Gaussians."""
        return cls(np.empty((n, 3), np.float32), np.empty((3, n, 3), np.float32), *np.empty((2, n, 3), np.float32))


def draw(
    gaussians: Gaussians, world: WorldGaussians, camera: Camera, rasteriser: Rasteriser, spaces: Spaces | None = None
) -> Frame:
    """Draw an avatar that was brought into the world, on white; `spaces` are filled where somebody wants them."""
    colours = sh_colours(
        gaussians.sh_dc, gaussians.sh_rest, world.means, camera.centre, gaussians.sh_degree, rasteriser.pool,
        out=None if spaces is None else spaces.colours, tilts=None if spaces is None else spaces.tilts,
    )  # fmt: skip
    splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
    return rasteriser.forward(splats, camera, WHITE)
