"""A static 3D Gaussian Splatting of one timestep, by this package's trainer: the preset, the head that is none, and the first Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import INITIAL_OPACITY, initial_gaussians, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.regions.scheme import PAPER
from sacha_core.train.options import LearningRates, LossOptions, Schedule, TrainOptions

__all__ = [
    "WORLD_FRAMES",
    "first_gaussians",
    "into_world",
    "static_options",
    "still_capture",
    "still_motion",
    "world_head",
]

TRIANGLES = 256  # all alike, so that the trainer, which shares its work out by triangles, has some to share
WHOLE = 30_000  # iterations of 3D Gaussian Splatting's own run
NORMAL = 1  # axis of a triangle's frame
SURE = 6.0  # logit of an opacity near 1
THIN, WIDE = np.log(0.05), np.log(0.7)  # of the patches that stand for triangles, in their units
LEAST_WEIGHT = 1.0  # pixels of blending weight over all views, of a triangle that is seen
NEIGHBOURS = 3  # whose mean squared distance gives a first size
NEAREST_M = 1e-4  # points closer than this count as this far apart, as no Gaussian may begin without size
ROWS = 512  # points at a time whose neighbours are sought
WORLD_FRAMES = TriangleFrames(np.eye(3, dtype=np.float32)[None], np.ones(1, np.float32), np.zeros((1, 3), np.float32))


def static_options(iterations: int = 2000, options: TrainOptions | None = None) -> TrainOptions:
    """Give 3D Gaussian Splatting's own rules, in fewer iterations, for `sacha_core.train.loop`.

    Kept: the losses (L1 and SSIM alone), the learning rates, growth at a gradient of 2e-4 in normalised device units, clone and split at
    1 % of the scene's extent, removal below an opacity of 0.005, no guard, no penalty for place or size, no tracked parameter fitted.

    Different from Inria's schedule of 30,000 iterations: all of it is scaled, so that the position's rate falls to its end within the run,
    harmonics gain a degree at each thirtieth, and growth ends at the half, as there; but growth begins after a twentieth (a sixtieth
    there) and comes at each fortieth (a three hundredth there), since gradients of fewer images say too little. Opacities are never
    reset, for which so short a run has no time, and nothing is removed for its size, which there begins after the first reset. Taken
    as it is and cut at 2,000 iterations, Inria's schedule would still grow at the end (measured: 5 dB lower with a fifth more Gaussians).
    First points are those of the tracked mesh and not of structure from motion. Images are drawn with gsplat's thresholds.

    Args:
        iterations: length of the run.
        options: whose seed, image size, device and threads to keep.

    Source: Kerbl et al., 3D Gaussian Splatting, SIGGRAPH 2023, and its public defaults.
    """
    base = options or TrainOptions()
    schedule = Schedule(
        iterations=iterations,
        position_decay=iterations,
        sh_every=max(1, iterations // 30),
        densify_from=iterations // 20,
        densify_every=max(1, iterations // 40),
        densify_until=iterations // 2,
        warm_up=1,
        calibrations=(),
        opacity_resets=(),
        size_prune_from=iterations,
    )
    return replace(
        base,
        variant="static",
        fine_tune=False,
        checkpoint_every=iterations,
        schedule=schedule,
        losses=LossOptions(sensitivity=0.0, position=0.0, scale=0.0),
        rates=LearningRates(position=1.6e-4, position_last=1.6e-6, log_scale=0.005, sensitivity_logit=0.0),
        density=replace(base.density, threshold=2e-4, by_region=False, guard_faint=False),
        pruning=replace(base.pruning, scope="none"),
    )


def world_head() -> HeadModel:
    """Give a head in whose triangles a local unit is a metre along the world's axes: what is bound to them stands in the world.

    The triangles lie upon each other, all with the identity for a frame: one edge along x, the normal along y, and edge and height of 2 m
    together. A head is what the trainer hangs Gaussians on; on this one they are those of a static scene.
    """
    corners = np.array([[-0.625, 0, 0.25], [0.625, 0, 0.25], [0, 0, -0.5]], np.float32)
    names = sorted({name for masks in PAPER.masks.values() for name in masks})
    nobody = np.zeros(0, np.int64)
    return HeadModel(
        name="world",
        v_template=corners,
        faces=np.tile(np.arange(3, dtype=np.int32), (TRIANGLES, 1)),
        shapedirs=np.zeros((3, 3, 0), np.float32),
        exprdirs=np.zeros((3, 3, 0), np.float32),
        J_regressor=np.full((1, 3), 1 / 3, np.float32),
        weights=np.ones((3, 1), np.float32),
        parents=np.array([-1]),
        masks={name: np.arange(3) if name == "face" else nobody for name in names},
    )


def still_motion(origin: Float[np.ndarray, "3"]) -> Motion:
    """Give the motion of `world_head` whose one frame has the triangles' origin there."""
    rest = Motion.rest(0, 0)
    return replace(rest, translation=np.asarray(origin, np.float32)[None])


def still_capture(capture: Capture, timestep: int, origin: Float[np.ndarray, "3"]) -> Capture:
    """Give the capture of one timestep as if there were no other, nor a head."""

    def at(views: Sequence[View]) -> tuple[View, ...]:
        return tuple(replace(view, timestep=0) for view in views if view.timestep == timestep)

    return Capture(capture.root, None, None, still_motion(origin), at(capture.train), at(capture.val), at(capture.test))


def first_gaussians(
    vertices: Float[np.ndarray, "v 3"],
    head: HeadModel,
    capture: Capture,
    views: Sequence[View],
    options: TrainOptions,
) -> Gaussians:
    """Give what a static fit starts from: points on the tracked mesh that the cameras see, in the colours that they see there.

    They stand for the points that 3D Gaussian Splatting gets from structure from motion: round, faint, and as large as the distance to
    the next three points.

    Args:
        vertices: (v, 3) posed, metres.
        head: whose triangles they make.
        capture: where the images are.
        views: the training views of this timestep.
        options: size of the images, degree of the harmonics.

    Returns:
        Gaussians in the world, without sensitivity, dealt to the triangles of `world_head`.

    Raises:
        GeometryError: a triangle is degenerate.
        DatasetError: an image cannot be decoded.
    """
    frames = triangle_frames(vertices.astype(np.float32), head.faces)
    weight, colour = _seen_colours(frames, capture, views, options)
    seen = weight >= LEAST_WEIGHT
    points, rgb = frames.origin[seen], colour[seen] / weight[seen, None]
    n = len(points)
    quaternions = np.zeros((n, 4), np.float32)
    quaternions[:, 0] = 1
    return Gaussians(
        position=points.astype(np.float32),
        log_scale=np.repeat(np.log(_spacing(points))[:, None], 3, axis=1).astype(np.float32),
        quaternion=quaternions,
        opacity_logit=np.full(n, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)), np.float32),
        sh_dc=((rgb - 0.5) / BASIS[0]).astype(np.float32),
        sh_rest=np.zeros((n, (options.sh_degree + 1) ** 2 - 1, 3), np.float32),
        binding=(np.arange(n) * TRIANGLES // max(n, 1)).astype(np.int32),
    )


def into_world(gaussians: Gaussians, origin: Float[np.ndarray, "3"]) -> Gaussians:
    """Give Gaussians that are bound to `world_head`, its triangles at `origin`, as Gaussians of the world, bound to triangle 0."""
    position = gaussians.position + np.asarray(origin, np.float32)
    binding = np.zeros(len(gaussians), np.int32)
    return replace(gaussians, position=position, binding=binding, sensitivity_logit=None)


def _seen_colours(
    frames: TriangleFrames, capture: Capture, views: Sequence[View], options: TrainOptions
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "f 3"]]:
    """Give each triangle's blending weight as an opaque patch, summed over the views that it faces, and the image's colours so summed."""
    start = initial_gaussians(len(frames.scale), np.random.default_rng(0), 0)
    sizes = np.tile(np.array([WIDE, THIN, WIDE], np.float32), (len(start), 1))
    world = to_world(replace(start, log_scale=sizes, opacity_logit=np.full(len(start), SURE, np.float32)), frames)
    black = np.zeros((len(start), 1), np.float32)
    splats = Splats(world.means, world.scales, world.quaternions, world.opacities, black)
    rasteriser, sums = Rasteriser(options.threads), np.zeros((len(start), 4))
    for view in views:
        image = capture.image(view, options.width, options.height)
        height, width = image.shape[:2]
        frame = rasteriser.forward(splats, view.camera.resized(width, height), np.zeros(1, np.float32))
        planes = np.concatenate([np.ones((1, height, width), np.float32), np.moveaxis(image, 2, 0) / np.float32(255)])
        faces_camera = np.einsum("fi,fi->f", frames.rotation[:, :, NORMAL], view.camera.centre - frames.origin) > 0
        sums += rasteriser.colour_weights(frame, planes) * faces_camera[:, None]
    return sums[:, 0], sums[:, 1:]


def _spacing(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Give the root of the mean squared distance to the next three points, metres."""
    exact = points.astype(np.float64)
    exact -= exact.mean(axis=0) if len(exact) else 0
    squares = (exact**2).sum(axis=1)
    spacing = np.full(len(exact), NEAREST_M)
    count = min(NEIGHBOURS, len(exact) - 1)
    for first in range(0, len(exact) if count > 0 else 0, ROWS):
        rows = slice(first, first + ROWS)
        distance = squares[rows, None] + squares - 2 * exact[rows] @ exact.T
        nearest = np.partition(distance, count, axis=1)[:, : count + 1].clip(min=0)
        # the point itself is the nearest of them, at 0 but for rounding
        spacing[rows] = np.sqrt((nearest.sum(axis=1) - nearest.min(axis=1)) / count)
    spacing[:] = spacing.clip(min=NEAREST_M)
    return spacing
