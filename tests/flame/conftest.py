"""A small head of random numbers: every term of the model is there and none is zero, so that a missing one shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic import synthetic_head

PARENTS = np.array([-1, 0, 1, 1, 1], np.int32)


def make_random_head(n_joints: int = 5, seed: int = 0, n_vertices: int = 30, correctives: bool = True) -> HeadModel:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    weights = rng.random((n_vertices, n_joints))
    regressor = rng.random((n_joints, n_vertices))
    return HeadModel(
        name="random",
        v_template=normal(n_vertices, 3),
        faces=np.array([rng.choice(n_vertices, 3, replace=False) for _ in range(40)], np.int32),
        shapedirs=normal(n_vertices, 3, 6) / 10,
        exprdirs=normal(n_vertices, 3, 7) / 10,
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=PARENTS[:n_joints],
        posedirs=normal(n_vertices, 3, 9 * (n_joints - 1)) / 10 if correctives else None,
        masks={"lips": np.arange(4, dtype=np.int32), "nose": np.arange(10, 12, dtype=np.int32)},
    )


def make_random_motion(head: HeadModel, n_frames: int = 4, seed: int = 1) -> Motion:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return Motion(
        shape=normal(head.shapedirs.shape[2]),
        static_offset=normal(head.n_vertices, 3) / 100,
        expression=normal(n_frames, head.exprdirs.shape[2]),
        rotation=normal(n_frames, 3),
        neck=normal(n_frames, 3),
        jaw=normal(n_frames, 3),
        eyes=normal(n_frames, 6),
        translation=normal(n_frames, 3),
    )


@pytest.fixture(scope="module", params=("full", "small"))
def size(request: pytest.FixtureRequest) -> str:
    """Of the synthetic head."""
    return request.param


@pytest.fixture(scope="module")
def head(size: str) -> HeadModel:
    return synthetic_head(size)


@pytest.fixture(scope="module")
def mirrored(head: HeadModel) -> np.ndarray:
    """For each vertex of the synthetic head its mirror image, found by position; no two vertices are in one place."""
    steps = np.round(head.v_template.astype(np.float64) * 2**20).astype(np.int64)  # the head is rounded to these
    place = {tuple(p): i for i, p in enumerate(steps.tolist())}
    assert len(place) == head.n_vertices
    return np.array([place[-x, y, z] for x, y, z in steps.tolist()])


@pytest.fixture(scope="session")
def random_head() -> HeadModel:
    return make_random_head()


@pytest.fixture(scope="session")
def random_motion(random_head: HeadModel) -> Motion:
    return make_random_motion(random_head)


@pytest.fixture(scope="session")
def make_head() -> Callable[..., HeadModel]:
    return make_random_head


@pytest.fixture(scope="session")
def make_motion() -> Callable[..., Motion]:
    return make_random_motion
