"""The scene that the rasteriser is timed on: flat Gaussians on a shell of the size of a head, drawn in four channels."""

from __future__ import annotations

import numpy as np

from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats

RADII = np.array([0.075, 0.11, 0.095])  # metres
FOCAL = 2050.0  # pixels at a height of 802: the head fills two thirds of it


def head_shell(n: int, channels: int = 4, seed: int = 0) -> Splats:
    """Give n Gaussians lying on the shell, some 1.2 mm wide and 0.4 mm thick, ordered along it as triangles of a mesh are."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    place = np.floor((normals + 1) * 8).astype(int)
    normals = normals[np.lexsort(place.T)]
    scales = np.array([1.2e-3, 1.2e-3, 0.4e-3]) * np.exp(rng.normal(size=(n, 3)) * 0.5)
    # the rotation that takes z to the normal, after a turn about z
    half = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(n)], 1)
    turn = rng.uniform(0, np.pi, n)
    w, x, y = half[:, 0], half[:, 1], half[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    quaternions = np.stack([w * c, x * c + y * s, y * c - x * s, w * s], 1)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    arrays = (normals * RADII, scales, quaternions, rng.uniform(0.1, 1, n), rng.uniform(0, 1, (n, channels)))
    return Splats(*(a.astype(np.float32) for a in arrays))


def front_camera(width: int, height: int) -> Camera:
    """Give a camera a metre before the face."""
    focal = FOCAL * height / 802
    return Camera.look_at(np.array([0.15, 0.05, 0.99]), np.zeros(3), width, height, focal)
