"""Random avatars for codec tests: no real material, every attribute drawn from what training tends to leave."""

from __future__ import annotations

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadReference

HEAD = HeadReference("random", "0123456789abcdef" * 4, 120, 200)


def random_gaussians(n: int, n_faces: int = HEAD.n_faces, n_harmonics: int = 15, seed: int = 0) -> Gaussians:
    """Give n Gaussians bound at random."""
    rng = np.random.default_rng(seed)
    f4 = np.float32
    return Gaussians(
        position=rng.normal(0, 0.7, (n, 3)).astype(f4),
        log_scale=rng.normal(-1.5, 0.9, (n, 3)).astype(f4),
        quaternion=rng.normal(0, 1, (n, 4)).astype(f4),
        opacity_logit=rng.normal(0, 2.5, n).astype(f4),
        sh_dc=rng.normal(0, 0.6, (n, 3)).astype(f4),
        sh_rest=rng.laplace(0, 0.05, (n, n_harmonics, 3)).astype(f4),
        binding=rng.integers(0, n_faces, n).astype(np.int32),
    )


def random_motion(n_frames: int, n_offsets: int = HEAD.n_vertices, n_expression: int = 20, seed: int = 0) -> Motion:
    """Give a smooth motion: sums of a few sines with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_frames)[:, None] / 25

    def wander(width: int, size: float) -> np.ndarray:
        speed, phase = rng.uniform(0.3, 3, width), rng.uniform(0, 6, width)
        return (size * np.sin(speed * t + phase) + rng.normal(0, size / 50, (n_frames, width))).astype(np.float32)

    return Motion(
        shape=rng.normal(0, 1, 30).astype(np.float32),
        static_offset=rng.normal(0, 1e-3, (n_offsets, 3)).astype(np.float32),
        expression=wander(n_expression, 1.0),
        rotation=wander(3, 0.3),
        neck=wander(3, 0.1),
        jaw=wander(3, 0.2),
        eyes=wander(6, 0.2),
        translation=wander(3, 0.02),
        frame_rate=25.0,
    )


def random_avatar(n: int, n_frames: int = 30, n_harmonics: int = 15, seed: int = 0) -> Avatar:
    """Give an avatar with a motion."""
    return Avatar(random_gaussians(n, n_harmonics=n_harmonics, seed=seed), HEAD, random_motion(n_frames, seed=seed))
