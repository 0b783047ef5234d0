"""A head with every term of the model, some Gaussians on it, and pictures to compare with; small enough to draw in plain torch."""

from __future__ import annotations

from dataclasses import dataclass

import gsplat_stand_in
import numpy as np
import torch
import trimesh

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.raster.camera import Camera
from sacha_core.train.cuda.engine import CudaEngine
from sacha_core.train.options import TrainOptions
from sacha_core.train.state import ATTRIBUTES, FITTED_MOTION, TrainState
from sacha_core.train.views import Target, box_of

RADIUS_M = 0.1
PER_TRIANGLE = 2
DEGREE = 3
MASKS = (
    "left_eyeball", "right_eyeball", "left_eye_region", "right_eye_region", "lips", "nose", "left_ear", "right_ear",
    "boundary", "scalp", "neck", "face", "forehead", "eye_region",
)  # fmt: skip
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Stage:
    """A head, its motion, and views of it."""

    head: HeadModel
    motion: Motion
    targets: tuple[Target, ...]

    def engine(self, **options) -> CudaEngine:
        """Give the engine on the CPU, drawing by the stand-in."""
        return CudaEngine(self.head, self.motion, TrainOptions(threads=1, **options), "cpu", gsplat_stand_in)


def ball(rng: np.random.Generator) -> HeadModel:
    """Make a ball with FLAME's five joints, expressions and pose correctives, and each vertex in one of its masks."""
    mesh = trimesh.creation.icosphere(1, RADIUS_M)
    v = len(mesh.vertices)
    weights = rng.random((v, 5)) ** 3
    regressor = rng.random((5, v))
    return HeadModel(
        name="ball",
        v_template=np.asarray(mesh.vertices, np.float32),
        faces=np.asarray(mesh.faces, np.int32),
        shapedirs=rng.normal(0, 0.002, (v, 3, 2)).astype(np.float32),
        exprdirs=rng.normal(0, 0.002, (v, 3, 4)).astype(np.float32),
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1], np.int32),
        posedirs=rng.normal(0, 0.001, (v, 3, 36)).astype(np.float32),
        masks={name: np.flatnonzero(np.arange(v) % len(MASKS) == place) for place, name in enumerate(MASKS)},
    )


def moving(head: HeadModel, rng: np.random.Generator, timesteps: int = 3) -> Motion:
    widths = {"expression": head.exprdirs.shape[2], "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6}
    dynamic = {name: rng.normal(0, 0.15, (timesteps, width)).astype(np.float32) for name, width in widths.items()}
    translation = rng.normal(0, 0.005, (timesteps, 3)).astype(np.float32)
    shape = rng.normal(0, 1, head.shapedirs.shape[2]).astype(np.float32)
    return Motion(shape, np.zeros((0, 3), np.float32), **dynamic, translation=translation)


def picture(timestep: int, angle: float, rng: np.random.Generator, width: int = 44, height: int = 37) -> Target:
    """Give a view of smooth colours with a white edge, by a camera off all axes."""
    eye = 0.5 * np.array([np.sin(angle), 0.2 * np.cos(3 * angle), np.cos(angle)])
    camera = Camera.look_at(eye, np.array([0.01, -0.005, 0]), width, height, 1.7 * width)
    y, x = np.mgrid[0:height, 0:width][:, None] / 9 + rng.uniform(0, 6, (2, 3, 1, 1))
    image = np.rint(127 + 100 * np.sin(x) * np.cos(y) + rng.uniform(-20, 20, x.shape)).astype(np.uint8)
    image[:, :4] = image[:, :, -5:] = 255
    sensitivity = rng.integers(0, 256, (height, width), dtype=np.uint8)
    sensitivity[:4] = sensitivity[:, -5:] = 0
    box = box_of((image != 255).any(axis=0) | (sensitivity != 0))
    return Target(timestep, camera, image, sensitivity, box)


def make_stage() -> Stage:
    """Give the head and seven views: four of timestep 1, the last of another size, and three of timestep 2."""
    rng = np.random.default_rng(5)
    head = ball(rng)
    targets = [picture(1, angle, rng) for angle in (0.3, 2.0, 4.1)] + [picture(1, 5.0, rng, 29, 52)]
    targets += [picture(2, angle, rng) for angle in (0.9, 2.9, 5.2)]
    return Stage(head, moving(head, rng), tuple(targets))


def make_state(stage: Stage, seed: int = 3) -> TrainState:
    """Make a state away from all special values, with moments and statistics of an earlier life."""
    rng = np.random.default_rng(seed)
    n = PER_TRIANGLE * len(stage.head.faces)
    widths = {"position": (3,), "log_scale": (3,), "quaternion": (4,), "sh_dc": (3,), "sh_rest": (15, 3)}
    spreads = {"position": 0.3, "log_scale": 0.4, "quaternion": 0.5, "sh_dc": 0.8, "sh_rest": 0.15}
    values = {name: rng.normal(0, spreads.get(name, 1), (n, *widths.get(name, ()))) for name in ATTRIBUTES}
    values["log_scale"] -= 1.2
    values["quaternion"][:, 0] += 1
    values["position"][::17] *= 5  # some stray, and some swell
    values["log_scale"][::13] += 1.2
    values["opacity_logit"] = np.minimum(values["opacity_logit"] + 0.5, 3.5)  # below where alpha is cut off
    values |= {name: getattr(stage.motion, name) for name in FITTED_MOTION}
    values = {name: np.array(value, np.float32) for name, value in values.items()}
    return TrainState(
        iteration=0,
        values=values,
        first={name: rng.normal(0, 1e-4, value.shape).astype(np.float32) for name, value in values.items()},
        second={name: rng.uniform(0, 1e-6, value.shape).astype(np.float32) for name, value in values.items()},
        steps={"gaussians": 20, "motion": 30},
        binding=np.repeat(np.arange(len(stage.head.faces), dtype=np.int32), PER_TRIANGLE),
        gradient_sum=rng.uniform(0, 1e-3, n).astype(np.float32),
        gradient_count=rng.integers(0, 9, n).astype(np.int32),
        thresholds=np.full(8, 3e-4),
        ratios=np.full(8, 0.2),
    )
