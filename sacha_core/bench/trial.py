"""Something to train on that needs no capture: views of a made avatar, and another that has gone astray from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.scenes import FOCAL, made_avatar
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.sensitivity_map import sensitivity_map
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar
from sacha_core.train.engine import Engine
from sacha_core.train.options import TrainOptions
from sacha_core.train.presets import preset
from sacha_core.train.rates import learning_rates
from sacha_core.train.state import TrainState, initial_state
from sacha_core.train.views import Target, box_of

__all__ = ["DEGREE", "Trial", "made_trial"]

DEGREE = 3
EXTENT_M = 1.1  # of the scene: cameras stand a metre around the head
TIMESTEPS = (1, 2)
WHITE = 255
N_REGIONS = 8


@dataclass(frozen=True)
class Trial:
    """Views, and an avatar that does not look like them yet.

    Args:
        head: of the person.
        motion: likewise.
        options: of the run.
        targets: views of another avatar.
        state: to begin with; copy it before training.
    """

    head: HeadModel
    motion: Motion
    options: TrainOptions
    targets: tuple[Target, ...]
    state: TrainState

    def step(self, engine: Engine, iteration: int) -> None:
        """Do one iteration: the view that is its turn, one camera."""
        engine.differentiate(iteration, [self.targets[iteration % len(self.targets)]], DEGREE)
        rates = learning_rates(self.options.rates, self.options.schedule, iteration, EXTENT_M)
        engine.advance(rates, frozenset())

    def run(self, engine: Engine, iterations: int, first: int = 1) -> None:
        """Do some iterations, and wait for them."""
        for iteration in range(first, first + iterations):
            self.step(engine, iteration)
        engine.losses()


@lru_cache(maxsize=2)
def made_trial(n: int, size: tuple[int, int], cameras: int, seed: int = 0) -> Trial:
    """Make views of an avatar of n Gaussians in two poses, and the avatar to be trained: the same, displaced and discoloured.

    Args:
        n: how many Gaussians.
        size: width and height of the images, pixels.
        cameras: how many see each pose.
        seed: of chance.
    """
    rng = np.random.default_rng(seed)
    avatar, head = made_avatar(n, DEGREE, n_frames=4, seed=seed)
    gaussians, motion = avatar.gaussians, avatar.motion
    assert motion is not None
    poser, targets = Poser(head, motion), []
    for timestep in TIMESTEPS:
        frames = triangle_frames(poser(timestep), head.faces)
        for place in range(cameras):
            camera = arc_camera(place, cameras, *size)
            targets.append(as_target(render_avatar(gaussians, frames, camera).colour, timestep, camera))
    options = preset("paper")
    state = initial_state(strayed(gaussians, rng), motion, N_REGIONS, options.density.threshold, options.pruning.ratio)
    return Trial(head, motion, options, tuple(targets), state)


def strayed(gaussians: Gaussians, rng: np.random.Generator) -> Gaussians:
    """Give Gaussians that lie and look a little otherwise."""
    return replace(
        gaussians,
        position=gaussians.position + rng.normal(0, 0.1, gaussians.position.shape).astype(np.float32),
        sh_dc=gaussians.sh_dc + rng.normal(0, 0.2, gaussians.sh_dc.shape).astype(np.float32),
    )


def arc_camera(place: int, count: int, width: int, height: int) -> Camera:
    """Give one of some cameras on a half circle before the face."""
    angle = np.pi * (place + 0.5) / count - np.pi / 2
    eye = np.array([np.sin(angle), 0.05, np.cos(angle)])
    return Camera.look_at(eye, np.zeros(3), width, height, FOCAL * height / 802)


def as_target(picture: Float[np.ndarray, "h w 3"], timestep: int, camera: Camera) -> Target:
    """Give a picture as what training compares with."""
    image = np.rint(WHITE * picture.clip(0, 1)).astype(np.uint8)
    sensitivity = sensitivity_map(image).astype(np.uint8) * np.uint8(WHITE)
    marked = (image != WHITE).any(axis=2) | (sensitivity != 0)
    planes = np.ascontiguousarray(image.transpose(2, 0, 1))
    return Target(timestep, camera, planes, sensitivity, box_of(marked))
