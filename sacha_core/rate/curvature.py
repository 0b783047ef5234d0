r"""What every number of an avatar is worth to pictures, measured by rendering.

A picture's change by a small change of the numbers is J times that. To push a picture e of random signs back through the rasteriser gives
$g = J^T e$, and since the signs of any two pixels agree as often as not, the mean of $g_i^2$ is $(J^T J)_{ii}$: one backward pass a view
gives an estimate of all of them at once. Many views of several poses average its noise away.

Source: Hutchinson's estimator for the diagonal of a Gauss-Newton matrix (Bekas, Kokiopoulou and Saad, 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import WorldGaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.importance import GaussianImportance
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.raster.camera import Camera
from sacha_core.raster.harmonics import sh_colours, sh_colours_backward, sh_rest_gradient
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import SplatGradients, Splats
from sacha_core.rate.kernels.sums import add_outer_products, add_squares, mirror, turn_back
from sacha_core.rate.views import Shot, measuring_shots
from sacha_core.rate.world import in_world

__all__ = ["LocalGradients", "draw", "importance_of", "local_gradients", "measure_importance"]

WHITE = np.ones(3, np.float32)
CAMERAS, DIRECTIONAL_CAMERAS = 2, 4  # a pose; a colour that depends on the direction wants to be seen from more of them
SUMMED = ("position", "log_scale", "rotation", "opacity", "sh_dc")


@dataclass(frozen=True)
class LocalGradients:
    """Gradients by the numbers that are coded, in the units of `GaussianImportance`.

    Args:
        position: (n, 3) by means in triangle units.
        log_scale: (n, 3) by logarithms of standard deviations.
        rotation: (n, 3) by a turn about each of the Gaussian's own axes.
        opacity: (n,) by theta = arcsin sqrt opacity.
        colour: (n, 3) by the colour seen, 0 where it was cut at black: those by its coefficients are the harmonics times it.
    """

    position: Float[np.ndarray, "n 3"]
    log_scale: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, "n 3"]
    opacity: Float[np.ndarray, " n"]
    colour: Float[np.ndarray, "n 3"]


def importance_of(
    avatar: Avatar, head: HeadModel, seed: int = 0, rasteriser: Rasteriser | None = None
) -> GaussianImportance:
    """Measure what every number of an avatar is worth, in its own motion, at half the resolution of `protocol_shots`.

    Takes about a second on one core for 20,000 Gaussians.

    Raises:
        GeometryError: a frame makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    n_cameras = DIRECTIONAL_CAMERAS if avatar.gaussians.sh_degree else CAMERAS
    return measure_importance(avatar.gaussians, measuring_shots(avatar, head, n_cameras), seed, rasteriser)


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
    metric = np.zeros((n, k + 1, k + 1), np.float32)
    for shot in shots:
        world = in_world(gaussians, shot)
        columns = np.empty((n, len(shot.cameras), k + 1), np.float32)
        for view, camera in enumerate(shot.cameras):
            frame = draw(gaussians, world, camera, rasteriser)
            signs = rng.integers(0, 2, frame.image.shape, np.int8)
            slopes = rasteriser.backward(frame, 2 * signs.astype(np.float32) - 1)
            weight = np.sqrt(np.mean(slopes.colours[:, :3] ** 2, axis=1, dtype=np.float64)).astype(np.float32)
            found = local_gradients(gaussians, shot.frames, world, frame, slopes)
            for name in ("position", "log_scale", "rotation", "opacity"):
                add_squares(in_columns(sums[name]), in_columns(getattr(found, name)))
            add_squares(sums["sh_dc"], np.float32(BASIS[0]) * weight[:, None] * (frame.splats.colours > 0))
            columns[:, view] = harmonics_times(weight, world.means, camera, gaussians.sh_degree)
        add_outer_products(metric, columns)
    mirror(metric, np.float32(1 / views))
    diagonal = np.diagonal(metric[:, 1:, 1:], axis1=1, axis2=2)
    rest = np.repeat(diagonal[:, :, None], 3, axis=2).astype(np.float64)
    means = {name: total / views for name, total in sums.items()}
    return GaussianImportance(**means, sh_rest=rest, colour_metric=metric)


def in_columns(values: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, "n c"]:
    """Give values of one number a row as a column."""
    return values if values.ndim == 2 else values[:, None]


def harmonics_times(
    weight: Float[np.ndarray, " n"], means: Float[np.ndarray, "n 3"], camera: Camera, degree: int
) -> Float[np.ndarray, "n k"]:
    """Give each Gaussian's weight times the harmonics in the direction in which a camera sees it, degree 0 first."""
    same = np.repeat(weight[:, None], 3, axis=1)
    rest = sh_rest_gradient(means, np.asarray(camera.centre, np.float32), degree, same, (degree + 1) ** 2 - 1)
    columns: np.ndarray = np.concatenate([np.float32(BASIS[0]) * weight[:, None], rest[:, :, 0]], axis=1)
    return columns


def draw(gaussians: Gaussians, world: WorldGaussians, camera: Camera, rasteriser: Rasteriser) -> Frame:
    """Draw an avatar that was brought into the world, on white."""
    colours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, world.means, camera.centre, gaussians.sh_degree)
    splats = Splats(world.means, world.scales, world.quaternions, world.opacities, colours)
    return rasteriser.forward(splats, camera, WHITE)


def local_gradients(
    gaussians: Gaussians, frames: TriangleFrames, world: WorldGaussians, frame: Frame, slopes: SplatGradients
) -> LocalGradients:
    """Carry gradients from the world back to what is coded.

    Args:
        gaussians: n of them.
        frames: of the pose.
        world: what they are in that pose.
        frame: what was drawn last.
        slopes: by the splats; the means' are changed where colours depend on them.
    """
    face, colours, centre = gaussians.binding, frame.splats.colours, np.asarray(frame.camera.centre, np.float32)
    cut = sh_colours_backward(
        gaussians.sh_rest, world.means, centre, gaussians.sh_degree, colours, slopes.colours, slopes.means
    )
    alpha, position = world.opacities, np.empty_like(slopes.means)
    turn_back(slopes.means, face, frames.rotation, frames.scale, position)
    return LocalGradients(
        position=position,
        log_scale=slopes.scales * world.scales,
        rotation=turn_gradient(world.quaternions, slopes.quaternions),
        opacity=slopes.opacities * (2 * np.sqrt(alpha * (1 - alpha))),
        colour=cut,
    )


def turn_gradient(quaternions: Float[np.ndarray, "n 4"], slopes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """Give the gradient by a turn about the own axes: a turn by v moves a unit quaternion q by q (0, v / 2)."""
    (w, x, y, z), (a, b, c, d) = quaternions.T, slopes.T
    turned = (w * b - x * a - y * d + z * c, w * c - y * a - z * b + x * d, w * d - z * a - x * c + y * b)
    gradient: np.ndarray = np.stack(turned, axis=1) * quaternions.dtype.type(0.5)
    return gradient
