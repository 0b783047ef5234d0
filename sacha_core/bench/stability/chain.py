"""A scene small enough that every parameter can be moved by hand: Gaussians on a posed head, and a view or two of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import torch

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.exact import Leaves
from sacha_core.bench.stability.exact_head import ExactHead
from sacha_core.bench.stability.exact_step import (
    BACKGROUND,
    ExactLoss,
    Seen,
    StepDecisions,
    exact_loss,
    step_leaves,
    world_leaves,
)
from sacha_core.errors import SachaError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.train.options import LossOptions
from sacha_core.train.state import TrainState, initial_state
from sacha_core.train.views import Target

__all__ = ["DEGREE", "Chain", "Setting", "as_seen", "chain"]

DEGREE = 3
N_GAUSSIANS, N_EXPRESSIONS, N_REGIONS = 24, 5, 8
SIDE, FOCAL = 32, 60.0  # pixels
BORDER = 24  # pixels of white around a cropped picture, more than its crop needs
EYES_M = ((0.1, 0.05, 0.6), (-0.3, -0.1, 0.5))
CLEAR = 1e-4  # relative distance from every threshold, at every pixel, so that float32 decides as float64 does
SEEDS = 200

Setting = Literal["one view", "cropped", "two views"]


@dataclass(frozen=True)
class Chain:
    """A scene, and its loss in float64.

    Args:
        head: the head.
        motion: of one timestep.
        state: Gaussians and that motion, float32.
        views: of that timestep.
        weights: of the losses.
    """

    head: HeadModel
    motion: Motion
    state: TrainState
    views: tuple[Seen, ...]
    weights: LossOptions

    @property
    def targets(self) -> list[Target]:
        """What the views are compared with."""
        return [view.target for view in self.views]

    @cached_property
    def exact_head(self) -> ExactHead:
        """The head in float64."""
        return ExactHead(self.head, self.motion)

    def losses(self, leaves: Leaves, decisions: Sequence[StepDecisions] | None = None) -> list[ExactLoss]:
        """Give the loss of each view at some parameters, as `step_leaves` gives them; that of a step is their mean."""
        scene = (self.exact_head, self.state.binding)
        kept: Sequence[StepDecisions | None] = decisions or [None] * len(self.views)
        return [
            exact_loss(leaves, *scene, view, DEGREE, self.weights, one)
            for view, one in zip(self.views, kept, strict=True)
        ]


@lru_cache(maxsize=8)
def chain(pose: float | None = None, setting: Setting = "one view") -> Chain:
    """Make a scene in which float32 decides as float64 does, away from every threshold: the first of some random ones.

    Args:
        pose: every component of every rotation vector, radians; None for random ones.
        setting: what is seen of it.
    """
    for seed in range(SEEDS):
        made = _random_chain(np.random.default_rng([seed, 7]), pose, setting)
        with torch.no_grad():
            bands = [loss.frame.band.min() for loss in made.losses(step_leaves(made.state, 0))]
        if min(bands) > CLEAR:
            return made
    raise SachaError(f"none of {SEEDS} scenes keeps clear of all thresholds")


def as_seen(world: Leaves, target: Target) -> Seen:
    """Give a view with the kernel's own depths of Gaussians in the world, and which of them it finds there."""
    splats = Splats(**{name: leaf.detach().numpy().astype(np.float32) for name, leaf in world.items()})
    frame = Rasteriser(1).forward(splats, target.camera, BACKGROUND)
    return Seen(target, frame.bins.projection.depths[: len(splats)].copy(), frame.visible.copy())


def _random_chain(rng: np.random.Generator, pose: float | None, setting: Setting) -> Chain:
    head = synthetic_head("small")
    binding = np.sort(rng.choice(head.n_faces, N_GAUSSIANS, replace=False)).astype(np.int32)
    motion = _random_motion(rng, head, pose)
    state = initial_state(_random_gaussians(rng, binding), motion, N_REGIONS, 3e-4, 0.2)
    exact_head, views = ExactHead(head, motion), []
    for eye in EYES_M[: 2 if setting == "two views" else 1]:
        target = _random_target(rng, eye, BORDER if setting == "cropped" else 0)
        with torch.no_grad():
            world, _ = world_leaves(step_leaves(state, 0), exact_head, binding, target.camera, DEGREE)
        views.append(as_seen(world, target))
    return Chain(head, motion, state, tuple(views), LossOptions())


def _random_target(rng: np.random.Generator, eye: tuple[float, ...], border: int) -> Target:
    """Give noise, with a border of white where nothing is sensitive."""
    camera = Camera.look_at(np.array(eye), np.array([0.0, -0.03, -0.04]), SIDE, SIDE, FOCAL)
    image, sensitivity = rng.integers(0, 256, (3, SIDE, SIDE), np.uint8), rng.integers(0, 256, (SIDE, SIDE), np.uint8)
    side = SIDE + 2 * border
    return Target(
        timestep=0,
        camera=replace(camera, width=side, height=side, cx=camera.cx + border, cy=camera.cy + border),
        image=np.pad(image, ((0, 0), (border, border), (border, border)), constant_values=255),
        sensitivity=np.pad(sensitivity, border),
        box=(border, border, border + SIDE, border + SIDE),
    )


def _random_motion(rng: np.random.Generator, head: HeadModel, pose: float | None) -> Motion:
    def vector(width: int) -> np.ndarray:
        return normal(0.2, (1, width)) if pose is None else np.full((1, width), pose, np.float32)

    def normal(spread: float, shape: tuple[int, ...]) -> np.ndarray:
        return rng.normal(0, spread, shape).astype(np.float32)

    return Motion(
        shape=normal(0.5, (head.shapedirs.shape[2],)),
        static_offset=normal(1e-3, (head.n_vertices, 3)),
        expression=normal(0.5, (1, N_EXPRESSIONS)),
        rotation=vector(3),
        neck=vector(3),
        jaw=vector(3),
        eyes=vector(6),
        translation=normal(0.01, (1, 3)),
    )


def _random_gaussians(rng: np.random.Generator, binding: np.ndarray) -> Gaussians:
    """Away from all special values; some stray or are swollen enough to be penalised."""
    n = len(binding)
    arrays: Mapping[str, np.ndarray] = {
        "position": rng.normal(0, 0.6, (n, 3)),
        "log_scale": rng.normal(-0.4, 0.5, (n, 3)),
        "quaternion": rng.normal(0, 1, (n, 4)),
        "opacity_logit": rng.normal(1, 3, n),
        "sensitivity_logit": rng.normal(0, 1, n),
        "sh_dc": rng.normal(0, 0.8, (n, 3)),
        "sh_rest": rng.normal(0, 0.2, (n, (DEGREE + 1) ** 2 - 1, 3)),
    }
    return Gaussians(**{name: array.astype(np.float32) for name, array in arrays.items()}, binding=binding)
