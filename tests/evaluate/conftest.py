"""A capture that shows an avatar exactly, so that judging that avatar has a known answer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.raster.camera import Camera
from sacha_core.raster.scene import render_avatar

SIZE = (48, 70)
CAMERAS = (3, 8)


@dataclass(frozen=True)
class Subject:
    """An avatar and the capture that shows it."""

    gaussians: Gaussians
    head: HeadModel
    motion: Motion
    capture: Capture


def wagging(head: HeadModel, n_frames: int, seed: int) -> Motion:
    rng = np.random.default_rng(seed)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames)
    turns = rng.normal(0, 0.2, (n_frames, 3)).astype(np.float32)
    return replace(rest, neck=turns, expression=rng.normal(0, 0.5, rest.expression.shape).astype(np.float32))


@pytest.fixture(scope="session")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    root = tmp_path_factory.mktemp("shown")
    head = synthetic_head("small")
    rng = np.random.default_rng(0)
    start = initial_gaussians(head.n_faces, rng)
    gaussians = replace(
        start,
        sh_dc=rng.normal(0, 1, start.sh_dc.shape).astype(np.float32),
        opacity_logit=np.full(len(start), 2.0, np.float32),
    )
    cameras = {
        index: Camera.look_at(np.array([x, 0.0, 1.0]), np.zeros(3), *SIZE, 150.0)
        for index, x in zip(CAMERAS, (0.4, 0.0), strict=True)
    }
    writer = CaptureWriter(root, "shown", head.reference)
    sequences = []
    for name, n_frames in (("EMO-1", 3), ("FREE", 2)):
        motion = wagging(head, n_frames, len(name))
        pose = Poser(head, motion)
        sequence = writer.sequence(name, motion, CAMERAS)
        for frame in range(n_frames):
            for index, camera in cameras.items():
                picture = render_avatar(gaussians, triangle_frames(pose(frame), head.faces), camera)
                image = np.round(255 * np.clip(picture.colour, 0, 1)).astype(np.uint8)
                mask = np.where(picture.alpha > 0.5, 255, 0).astype(np.uint8)
                sequence.add(frame, index, camera, image, mask)
        sequence.finish()
        sequences.append(sequence)
    capture = read_capture(writer.finish(sequences[:1], sequences[1:]))
    return Subject(gaussians, head, capture.motion, capture)
