"""Heads and motions made of random numbers, as varied as the format allows."""

from __future__ import annotations

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel

N_EXPRESSION = 21  # two groups of eight directions and some left over


def random_head(n_joints: int = 5, correctives: bool = True, v: int = 1200, f: int = 700) -> HeadModel:
    """More vertices and triangles than one block of the kernels, and no multiple of one."""
    rng = np.random.default_rng(n_joints)
    weights, regressor = rng.random((v, n_joints)), rng.random((n_joints, v))
    weights[: v // 2, 1:] = 0
    faces = np.stack([rng.permutation(v)[:f], rng.permutation(v)[:f], rng.permutation(v)[:f]], axis=1)
    faces = faces[(np.diff(np.sort(faces), axis=1) > 0).all(axis=1)]
    return HeadModel(
        name="random",
        v_template=rng.normal(size=(v, 3)).astype(np.float32),
        faces=faces.astype(np.int32),
        shapedirs=rng.normal(size=(v, 3, 2)).astype(np.float32),
        exprdirs=(rng.normal(size=(v, 3, N_EXPRESSION)) / 10).astype(np.float32),
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1], np.int32)[:n_joints],
        posedirs=(rng.normal(size=(v, 3, 9 * (n_joints - 1))) / 10).astype(np.float32) if correctives else None,
    )


def random_motion(n_frames: int = 3, n_expression: int = N_EXPRESSION) -> Motion:
    rng = np.random.default_rng(7)
    widths = {"expression": n_expression, "rotation": 3, "neck": 3, "jaw": 3, "eyes": 6, "translation": 3}
    dynamic = {name: rng.normal(size=(n_frames, width)).astype(np.float32) for name, width in widths.items()}
    return Motion(shape=rng.normal(size=2).astype(np.float32), static_offset=np.zeros((0, 3), np.float32), **dynamic)


def random_gaussians(n_faces: int, n: int = 1000, sh_degree: int = 3) -> Gaussians:
    rng = np.random.default_rng(11)
    shapes = ((n, 3), (n, 3), (n, 4), (n,), (n, 3), (n, (sh_degree + 1) ** 2 - 1, 3))
    attributes = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    return Gaussians(*attributes, rng.integers(0, n_faces, n).astype(np.int32))
