"""Oracles: SciPy's rotations of explicit covariances; laws of rigid motion; the published initial values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sacha_core.avatar.binding import initial_gaussians, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import GeometryError
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames, triangle_frames

ROUNDING_32 = 3e-6  # a product of three float32 matrices with entries of size one
VERTICES = np.random.default_rng(0).normal(size=(12, 3))
MOVE = np.array([1.0, 2, 3])
FACES = np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11], [2, 1, 7]])


def random_gaussians(n: int = 60) -> Gaussians:
    rng = np.random.default_rng(1)
    return replace(
        initial_gaussians(len(FACES), rng).select(np.zeros(n, np.int64)),
        position=rng.normal(size=(n, 3)),
        log_scale=rng.normal(size=(n, 3)) / 2,
        quaternion=rng.normal(size=(n, 4)) * 3,
        opacity_logit=rng.normal(size=n) * 3,
        binding=rng.integers(len(FACES), size=n).astype(np.int32),
    )


def covariance(q: np.ndarray, scales: np.ndarray) -> np.ndarray:
    axes = quaternion.to_matrix(q.astype(np.float64)) * scales[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def test_means_and_covariances_follow_the_frame() -> None:
    gaussians, frames = random_gaussians(), triangle_frames(VERTICES, FACES)
    world = to_world(gaussians, frames)
    local_covariance = covariance(gaussians.quaternion, np.exp(gaussians.log_scale))
    world_covariance = covariance(world.quaternions, world.scales)
    for i, face in enumerate(gaussians.binding):
        m = frames.scale[face] * frames.rotation[face]
        np.testing.assert_allclose(
            world.means[i], m @ gaussians.position[i] + frames.origin[face], rtol=ROUNDING_32, atol=ROUNDING_32
        )
        expected = m @ local_covariance[i] @ m.T
        np.testing.assert_allclose(world_covariance[i], expected, atol=ROUNDING_32 * np.abs(expected).max())


def test_opacity_is_the_sigmoid_without_overflow() -> None:
    gaussians = replace(random_gaussians(5), opacity_logit=np.array([-1e30, -20, 0, 20, 1e30]))
    expected = [0, 1 / (1 + np.exp(20)), 0.5, 1 / (1 + np.exp(-20)), 1]
    np.testing.assert_allclose(to_world(gaussians, triangle_frames(VERTICES, FACES)).opacities, expected, rtol=1e-6)


def test_turning_the_mesh_turns_the_gaussians() -> None:
    gaussians, turn = random_gaussians(), Rotation.from_rotvec([0.3, -1.1, 2.0])
    before = to_world(gaussians, triangle_frames(VERTICES, FACES))
    after = to_world(gaussians, triangle_frames(turn.apply(VERTICES) + MOVE, FACES))
    np.testing.assert_allclose(after.means, turn.apply(before.means) + MOVE, atol=10 * ROUNDING_32)
    np.testing.assert_allclose(after.scales, before.scales, rtol=ROUNDING_32)
    expected = covariance(quaternion.multiply(turn.as_quat(scalar_first=True), before.quaternions), before.scales)
    np.testing.assert_allclose(covariance(after.quaternions, after.scales), expected, atol=1e-4)


def test_everything_is_float32() -> None:
    world = to_world(random_gaussians(), triangle_frames(VERTICES, FACES))
    for name in ("means", "scales", "quaternions", "opacities"):
        assert getattr(world, name).dtype == np.float32


def test_a_scale_beyond_float32_is_infinite_without_a_word() -> None:
    gaussians = replace(random_gaussians(2), log_scale=np.float32([[1e30, 0, -1e30], [0, 0, 0]]))
    scales = to_world(gaussians, triangle_frames(VERTICES, FACES)).scales
    assert scales[0, 0] == np.inf
    assert scales[0, 2] == 0
    assert np.isfinite(scales[1]).all()


@pytest.mark.parametrize("face", [-1, 5])
def test_a_binding_out_of_range_is_named(face: int) -> None:
    gaussians = random_gaussians(4)
    gaussians.binding[2] = face
    with pytest.raises(GeometryError, match=f"Gaussian 2 is bound to triangle {face}; the mesh has triangles 0 to 4"):
        to_world(gaussians, triangle_frames(VERTICES, FACES))


@pytest.mark.parametrize(("degree", "coefficients"), [(0, 0), (1, 3), (2, 8), (3, 15)])
def test_initial_gaussians(degree: int, coefficients: int) -> None:
    start = initial_gaussians(50, np.random.default_rng(0), degree)
    start.validate(50)
    assert start.sh_rest.shape == (50, coefficients, 3)
    assert start.sh_degree == degree
    np.testing.assert_array_equal(start.binding, np.arange(50))
    np.testing.assert_allclose(start.opacity_logit, -2.1972246, rtol=1e-7)
    assert 0 <= start.sh_dc.min() <= start.sh_dc.max() < 1 / 255
    assert len(np.unique(start.sh_dc)) > 100
    frames = TriangleFrames(
        np.broadcast_to(np.eye(3, dtype=np.float32), (50, 3, 3)),
        np.linspace(1, 2, 50, dtype=np.float32),
        np.ones((50, 3), np.float32),
    )
    world = to_world(start, frames)
    np.testing.assert_array_equal(world.means, frames.origin)
    np.testing.assert_array_equal(world.scales, np.repeat(frames.scale[:, None], 3, 1))
    np.testing.assert_array_equal(world.quaternions, np.tile(np.float32([1, 0, 0, 0]), (50, 1)))


def test_nothing_at_all() -> None:
    world = to_world(random_gaussians().select(np.zeros(0, np.int64)), triangle_frames(VERTICES, FACES))
    assert world.means.shape == (0, 3)
