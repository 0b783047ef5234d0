"""Filming: takes of a subject, and the pictures that the cameras get of each moment."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import UInt8

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, person_template
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.camera import Camera
from sacha_core.synthesis.cameras import camera_rig
from sacha_core.synthesis.options import SynthOptions
from sacha_core.synthesis.renderer import Renderer
from sacha_core.synthesis.sequences import perform
from sacha_core.synthesis.subject import Subject

__all__ = ["Picture", "Take", "film", "plan_takes"]

SEAT_M = 0.02  # how far the subject sits from the middle of the rig, another way for each sequence


@dataclass(frozen=True)
class Take:
    """One sequence before it is filmed.

    Args:
        name: of its script.
        held_out: whether it is kept for testing.
        truth: the motion that the images show.
        tracked: the same with tracking noise, which is what a dataset knows.
        cameras: by index; they differ between takes, since the mean translation of each is its origin.
    """

    name: str
    held_out: bool
    truth: Motion
    tracked: Motion
    cameras: dict[int, Camera]


@dataclass(frozen=True)
class Picture:
    """What one camera got of one moment.

    Args:
        timestep: frame of the take.
        camera_index: which camera.
        camera: that camera.
        image: (h, w, 3) sRGB on white.
        mask: (h, w) 255 where the subject is.
    """

    timestep: int
    camera_index: int
    camera: Camera
    image: UInt8[np.ndarray, "h w 3"]
    mask: UInt8[np.ndarray, "h w"]


def plan_takes(head: HeadModel, options: SynthOptions) -> tuple[Take, ...]:
    """Give the takes that options ask for, those to train on first.

    A capture is made of them like this; the arguments of the writer that are left out have good defaults:

    ```
    takes = plan_takes(head, options)
    writer = CaptureWriter(root, f"synthetic-{options.seed}", head.reference, origin=options.origin(head.reference.sha256))
    sequences = {take.name: writer.sequence(take.name, take.tracked, tuple(take.cameras)) for take in takes}
    for take in takes:
        sequence = sequences[take.name]
        if sequence.is_complete():
            continue
        for picture in film(head, take, options, report=report):
            sequence.add(picture.timestep, picture.camera_index, picture.camera, picture.image, picture.mask)
        sequence.finish()
    union = writer.finish([sequences[name] for name in options.train], [sequences[options.test]])
    ```

    Args:
        head: who performs.
        options: what shall be filmed.

    Raises:
        OptionError: there is no such sequence.
    """
    rig = camera_rig(options.width, options.height)
    takes: list[Take] = []
    for name in (*options.train, options.test):
        held_out = name == options.test
        truth = perform(head, name, options.test_timesteps if held_out else options.train_timesteps, options.seed)
        rng = np.random.default_rng([options.seed, len(takes), 2])
        seat = rng.normal(size=3)
        seat *= SEAT_M / np.linalg.norm(seat)
        cameras = {index: moved(rig[index], seat) for index in options.cameras}
        takes.append(Take(name, held_out, truth, with_tracking_noise(truth, options, rng), cameras))
    return tuple(takes)


def moved(camera: Camera, by: np.ndarray) -> Camera:
    """Give the camera as it stands after the world's origin moved by `by`, metres."""
    return replace(camera, translation=camera.translation + camera.rotation @ by)


def with_tracking_noise(motion: Motion, options: SynthOptions, rng: np.random.Generator) -> Motion:
    """Give the motion as a tracker would: the truth and an error that differs from frame to frame."""
    sigmas = {
        "expression": options.expression_noise,
        **dict.fromkeys(("rotation", "neck", "jaw", "eyes"), options.pose_noise_rad),
        "translation": options.translation_noise_m,
    }
    noisy = {}
    for name, sigma in sigmas.items():
        truth = getattr(motion, name)
        noisy[name] = (truth + sigma * rng.standard_normal(truth.shape)).astype(np.float32)
    return replace(motion, **noisy)


def film(
    head: HeadModel, take: Take, options: SynthOptions, threads: int | None = None, report: Report = silent
) -> Iterator[Picture]:
    """Film one take: pictures of all cameras moment by moment, drawn ahead by a few threads, the same for any number of them.

    Args:
        head: who performs.
        take: what.
        options: those that the take was planned with.
        threads: how many; as many as the machine has cores by default.
        report: told after each picture.

    Yields:
        Pictures by timestep, then by camera.

    Raises:
        HeadError: the head lacks a mask that its appearance needs.
        GeometryError: a triangle of the posed head has no area.
    """
    poser = Poser(head, take.truth)
    subject = Subject(head, person_template(head, take.truth)[0], options.seed)
    own = threading.local()

    def shoot(timestep: int) -> list[Picture]:
        renderer = getattr(own, "renderer", None) or Renderer(options.supersample)
        own.renderer = renderer
        scene = subject.scene(poser(timestep))
        return [Picture(timestep, i, camera, *renderer.draw(scene, camera)) for i, camera in take.cameras.items()]

    total, done = len(take.truth) * len(take.cameras), 0
    n_threads = threads or os.cpu_count() or 1
    with ThreadPoolExecutor(n_threads) as pool:
        waiting: deque[Future[list[Picture]]] = deque()
        try:
            for timestep in range(len(take.truth) + n_threads):
                if timestep < len(take.truth):
                    waiting.append(pool.submit(shoot, timestep))
                if timestep < n_threads:
                    continue
                for picture in waiting.popleft().result():
                    yield picture
                    done += 1
                    report(Progress(f"film {take.name}", done, total))
        finally:
            for future in waiting:  # whoever was watching has left
                future.cancel()
