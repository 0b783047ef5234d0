"""Small scenes for the tests of the rasteriser."""

from __future__ import annotations

import numpy as np

from sacha_core.raster.camera import Camera
from sacha_core.raster.splats import Splats


def scene(seed: int, n: int, channels: int = 3, size: float = 0.03, spread: float = 0.15) -> Splats:
    """Give n Gaussians around the origin, float32; `size` is their middle standard deviation, metres."""
    rng = np.random.default_rng(seed)
    arrays = (
        rng.normal(size=(n, 3)) * spread,
        size * np.exp(rng.normal(size=(n, 3)) * 0.6),
        rng.normal(size=(n, 4)),
        rng.uniform(0.02, 1, n),
        rng.uniform(0, 1, (n, channels)),
    )
    return Splats(*(a.astype(np.float32) for a in arrays))


def camera(width: int = 45, height: int = 70, focal: float = 75.0) -> Camera:
    """Give a camera a metre away, off the axes, its principal point off the centre."""
    looking = Camera.look_at(np.array([0.3, 0.2, 0.95]), np.array([0.01, -0.02, 0.0]), width, height, focal)
    return Camera(
        width, height, focal, 1.1 * focal, width / 2 + 1.3, height / 2 - 0.7, looking.rotation, looking.translation
    )
