"""A capture of a head drawn triangle by triangle, so that its masks are exactly where the head is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from PIL import Image, ImageDraw

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import Capture, read_capture
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.raster.camera import Camera

SIZE, FOCAL = (80, 116), 170.0
SKIN = (190, 150, 130)


@dataclass(frozen=True)
class Framed:
    """A head and a capture of it, with white all round."""

    head: HeadModel
    motion: Motion
    capture: Capture


def drawn(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> np.ndarray:
    seen = vertices @ camera.rotation.T + camera.translation
    places = seen[:, :2] / seen[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    mask = Image.new("L", (camera.width, camera.height))
    pen = ImageDraw.Draw(mask)
    for triangle in places[faces]:
        pen.polygon([tuple(corner) for corner in triangle.tolist()], fill=255)
    return np.asarray(mask)


@pytest.fixture(scope="session")
def framed(tmp_path_factory: pytest.TempPathFactory) -> Framed:
    root = tmp_path_factory.mktemp("framed")
    head = synthetic_head("small")
    cameras = {
        index: Camera.look_at(np.array([x, 0.0, 1.0]), np.zeros(3), *SIZE, FOCAL)
        for index, x in ((3, 0.4), (8, 0.0), (10, -0.5))  # 8 is held out
    }
    rng = np.random.default_rng(5)
    writer, sequences = CaptureWriter(root, "framed", head.reference), []
    for name, n_frames in (("EMO-1", 3), ("FREE", 2)):
        rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames)
        motion = replace(rest, expression=rng.normal(0, 0.5, rest.expression.shape).astype(np.float32))
        pose, sequence = Poser(head, motion), writer.sequence(name, motion, tuple(cameras))
        for frame in range(n_frames):
            for index, camera in cameras.items():
                mask = drawn(pose(frame), head.faces, camera)
                sequence.add(frame, index, camera, np.where(mask[..., None] > 0, np.uint8(SKIN), np.uint8(255)), mask)
        sequence.finish()
        sequences.append(sequence)
    capture = read_capture(writer.finish(sequences[:1], sequences[1:]))
    return Framed(head, capture.motion, capture)
