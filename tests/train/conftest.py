"""A capture small enough to train on in a test: a ball of 80 triangles in coloured patches, seen from six sides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture, View
from sacha_core.raster.camera import Camera

RADIUS_M = 0.1
SIZE = 48
MASKS = (
    "left_eyeball", "right_eyeball", "left_eye_region", "right_eye_region", "lips", "nose", "left_ear", "right_ear",
    "boundary", "scalp", "neck", "face", "forehead", "eye_region",
)  # fmt: skip


@dataclass(frozen=True)
class Tiny:
    """A head and a capture of it."""

    head: HeadModel
    capture: Capture


def ball(seed: int = 0) -> HeadModel:
    """Make a ball with two joints, three expressions, and each vertex in one of FLAME's masks."""
    mesh = trimesh.creation.icosphere(1, RADIUS_M)
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)
    rng = np.random.default_rng(seed)
    v = len(vertices)
    upper = (vertices[:, 1] > 0).astype(np.float32)
    owner = np.argsort(np.argsort(np.arctan2(vertices[:, 0], vertices[:, 2]))) * len(MASKS) // v
    return HeadModel(
        name="ball",
        v_template=vertices,
        faces=faces,
        shapedirs=np.zeros((v, 3, 2), np.float32),
        exprdirs=rng.normal(0, 0.004, (v, 3, 3)).astype(np.float32),
        J_regressor=np.full((2, v), 1 / v, np.float32),
        weights=np.stack([1 - upper, upper], axis=1),
        parents=np.array([-1, 0]),
        masks={name: np.flatnonzero(owner == i) for i, name in enumerate(MASKS)},
    )


def picture(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    """Draw the ball as a disc, coloured by where each ray meets it, on white."""
    y, x = np.mgrid[0:SIZE, 0:SIZE] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera.rotation
    along = -rays @ camera.centre
    miss = np.sum(camera.centre**2) - along**2
    depth = along - np.sqrt(np.maximum(RADIUS_M**2 - miss, 0))
    points = camera.centre + rays * depth[..., None]
    colour = 0.5 + 0.4 * np.sign(np.sin(45 * points)) * np.array([1, 0.5, -0.7])
    colour[miss > RADIUS_M**2] = 1
    return (np.clip(colour, 0, 1) * 255).round().astype(np.uint8)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    """Give the ball and a capture of it: two training timesteps from six cameras, and a third timestep held out."""
    root: Path = tmp_path_factory.mktemp("tiny")
    rng = np.random.default_rng(1)
    head = ball()
    views = []
    for timestep in range(3):
        for index in range(6):
            angle = index * np.pi / 3
            eye = 0.5 * np.array([np.sin(angle), 0.3 * (-1) ** index, np.cos(angle)])
            camera = Camera.look_at(eye, np.zeros(3), SIZE, SIZE, 1.8 * SIZE)
            path = root / f"{timestep}_{index}.png"
            Image.fromarray(picture(camera, rng)).save(path)
            views.append(View(timestep, index, camera, path, None))
    motion = Motion.rest(0, 3, 3)
    capture = Capture(root, head.reference, None, motion, tuple(views[:12]), (), tuple(views[12:]))
    return Tiny(head, capture)
