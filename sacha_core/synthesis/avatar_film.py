"""Filming an avatar that somebody has already: takes of it, and the pictures that the cameras get of each moment."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.synthesis.acting import act
from sacha_core.synthesis.excerpts import cut_excerpts
from sacha_core.synthesis.film import SEAT_M, Picture, Take, moved, with_tracking_noise
from sacha_core.synthesis.framing import Framing, frame_avatar
from sacha_core.synthesis.options import SynthOptions

__all__ = ["Sitter", "average_blocks", "film_avatar", "plan_avatar_takes"]

VERSION = 1  # of appearance and motion; raise it with any change that shows


@dataclass(frozen=True)
class Sitter:
    """An avatar before the cameras.

    Args:
        gaussians: its canonical Gaussians.
        head: that they are bound to.
        identity: a motion whose shape and static offset are the person's; None for the head's mean.
    """

    gaussians: Gaussians
    head: HeadModel
    identity: Motion | None = None

    def at_rest(self) -> Motion:
        """Give the person with a neutral face, for one frame."""
        head = self.head
        rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
        return rest if self.identity is None else self.as_person(rest)

    def as_person(self, motion: Motion) -> Motion:
        """Give a motion performed by this person."""
        if self.identity is None:
            return motion
        return replace(motion, shape=self.identity.shape, static_offset=self.identity.static_offset)

    def framing(self, width: int, height: int) -> Framing:
        """Give where the rig stands for this person.

        Raises:
            OptionError: nothing of the avatar shows.
            GeometryError: a triangle of the head at rest has no area.
        """
        vertices = Poser(self.head, self.at_rest())(0)
        return frame_avatar(self.gaussians, vertices, triangle_frames(vertices, self.head.faces), width, height)

    def origin(self, options: SynthOptions) -> dict[str, Any]:
        """Give what decides the images of a sequence besides its motion."""
        digest = hashlib.sha256()
        for field in fields(self.gaussians):
            value = getattr(self.gaussians, field.name)
            if isinstance(value, np.ndarray):
                digest.update(
                    f"{field.name} {value.dtype} {value.shape}".encode() + np.ascontiguousarray(value).tobytes()
                )
        made = options.origin(self.head.reference.sha256)
        return made | {"maker": "sacha synth --avatar", "version": VERSION, "gaussians_sha256": digest.hexdigest()}


def plan_avatar_takes(sitter: Sitter, options: SynthOptions, motion: Motion | None = None) -> tuple[Take, ...]:
    """Give the takes that options ask for, those to train on first.

    Args:
        sitter: who performs.
        options: what shall be filmed.
        motion: to cut the sequences out of; None to have them acted by the options' seed.

    Raises:
        OptionError: there is no such sequence, the motion is too short, or nothing of the avatar shows.
        HeadError: the head cannot move so.
    """
    names = (*options.train, options.test)
    counts = (*(options.train_timesteps for _ in options.train), options.test_timesteps)
    if motion is None:
        shape = None if sitter.identity is None else sitter.identity.shape
        acted: Sequence[Motion] = [
            act(sitter.head, *named, options.seed, shape) for named in zip(names, counts, strict=True)
        ]
    else:
        acted = cut_excerpts(motion, counts)
    rig = sitter.framing(options.width, options.height).rig(options.width, options.height)
    takes = []
    for name, performance in zip(names, acted, strict=True):
        truth = sitter.as_person(performance)
        rng = np.random.default_rng([options.seed, zlib.crc32(name.encode()), 2])
        seat = rng.normal(size=3)
        seat *= SEAT_M / np.linalg.norm(seat)
        cameras = {index: moved(rig[index], seat) for index in options.cameras}
        takes.append(Take(name, name == options.test, truth, with_tracking_noise(truth, options, rng), cameras))
    return tuple(takes)


def film_avatar(
    sitter: Sitter, take: Take, options: SynthOptions, rasteriser: Rasteriser | None = None
) -> Iterator[Picture]:
    """Film one take.

    Args:
        sitter: who performs.
        take: what.
        options: those that the take was planned with.
        rasteriser: to use again; a new one by default.

    Yields:
        Pictures by timestep, then by camera; the mask is the avatar's alpha.

    Raises:
        GeometryError: a triangle of the posed head has no area.
    """
    rasteriser = rasteriser or Rasteriser()
    poser = Poser(sitter.head, take.truth)
    for timestep in range(len(take.truth)):
        frames = triangle_frames(poser(timestep), sitter.head.faces)
        for index, camera in take.cameras.items():
            fine = enlarged(camera, options.supersample)
            drawn = render_avatar(sitter.gaussians, frames, fine, rasteriser=rasteriser)
            image = as_bytes(average_blocks(drawn.colour, options.supersample))
            mask = as_bytes(average_blocks(drawn.alpha[..., None], options.supersample)[..., 0])
            yield Picture(timestep, index, camera, image, mask)


def enlarged(camera: Camera, factor: int) -> Camera:
    """Give the camera of the same view with `factor` times the pixels along each side."""
    return camera.resized(camera.width * factor, camera.height * factor)


def average_blocks(samples: Float[np.ndarray, "y x c"], factor: int) -> Float[np.ndarray, "h w c"]:
    """Give the mean of each block of `factor` by `factor` samples, each cut to [0, 1] first, as a sensor would be saturated.

    sRGB values are averaged as they are, as training does when it makes images smaller and as blending itself does.
    """
    height, width, channels = (samples.shape[0] // factor, samples.shape[1] // factor, samples.shape[2])
    blocks = np.clip(samples, 0, 1).reshape(height, factor, width, factor, channels)
    averaged: np.ndarray = blocks.mean(axis=(1, 3), dtype=np.float32)
    return averaged


def as_bytes(values: Float[np.ndarray, "..."]) -> UInt8[np.ndarray, "..."]:
    """Round [0, 1] to bytes."""
    rounded: np.ndarray = np.rint(values * 255).astype(np.uint8)
    return rounded
