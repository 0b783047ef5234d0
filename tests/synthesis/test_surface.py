"""The finer surface, the light on it, and strands that follow it: by theorems of their geometry."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sacha_core.geometry.triangle import triangle_frames
from sacha_core.synthesis.light import Shadows, Studio
from sacha_core.synthesis.strands import Strands
from sacha_core.synthesis.surface import subdivide

FLAT_TOLERANCE = 1e-6  # float32 positions of about 1
RIGID_TOLERANCE = 1e-6  # float64 frames
ROUNDED = 0.1  # exact normals would leave a fourth-order error, 0.01 here; those of an uneven mesh leave some of the second order
QUADRATURE = 0.03  # 36 directions integrate a cosine over a hemisphere to within 3 %

OCTAHEDRON = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], np.float32)
OCTAHEDRON_FACES = np.array(
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]], np.int32
)


def sphere(rounds: int) -> tuple[np.ndarray, np.ndarray]:
    fine = subdivide(OCTAHEDRON_FACES, 6, rounds)
    points = fine.interpolate(OCTAHEDRON)
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32), fine.faces[-1]


@pytest.mark.parametrize("rounds", [0, 1, 2, 3])
def test_subdivision_keeps_the_sphere_closed(rounds: int) -> None:
    fine = subdivide(OCTAHEDRON_FACES, 6, rounds)
    faces = fine.faces[-1]
    assert len(faces) == 8 * 4**rounds
    edges = {tuple(sorted(edge)) for face in faces for edge in zip(face, np.roll(face, -1), strict=True)}
    n_vertices = faces.max() + 1
    assert n_vertices - len(edges) + len(faces) == 2  # Euler
    directed = {(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    assert len(directed) == 3 * len(faces)  # every edge once in each direction: closed, one orientation
    points, normals = fine.refine(OCTAHEDRON)
    assert len(points) == n_vertices
    assert np.array_equal(points[:6], OCTAHEDRON)
    assert (np.einsum("vc,vc->v", points, normals) > 0).all()  # outwards
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=FLAT_TOLERANCE)


def test_children_lie_in_their_parent() -> None:
    fine = subdivide(OCTAHEDRON_FACES, 6, 2)
    centres = fine.interpolate(OCTAHEDRON)[fine.faces[-1]].mean(axis=1)
    parents = OCTAHEDRON[OCTAHEDRON_FACES].mean(axis=1)[np.arange(len(centres)) // 16]
    assert (np.sign(centres) == np.sign(parents)).all()  # one octant for each face


def test_a_plane_stays_flat_and_a_sphere_becomes_rounder() -> None:
    rng = np.random.default_rng(0)
    corners = np.concatenate([rng.uniform(-1, 1, (3, 2)), np.zeros((3, 1))], axis=1).astype(np.float32)
    points, _ = subdivide(np.array([[0, 1, 2]]), 3, 2).refine(corners)
    assert np.abs(points[:, 2]).max() < FLAT_TOLERANCE
    coarse, faces = sphere(3)
    fine = subdivide(faces, len(coarse), 1)
    rounded, _ = fine.refine(coarse)
    flat = fine.interpolate(coarse)
    error = lambda p: np.abs(np.linalg.norm(p, axis=1) - 1).max()  # noqa: E731
    assert error(rounded) < ROUNDED * error(flat)


def even_studio(radiance: float) -> Studio:
    return Studio((), (radiance,) * 3, (radiance,) * 3)


def test_an_even_sky_lights_everything_evenly() -> None:
    """Irradiance under a uniform sky of radiance L is L (with the factor pi left out), however the surface is turned."""
    vertices, faces = sphere(1)
    vertices = vertices * 1e-3 - (0, 5, 0)  # a speck far away, that shadows nothing
    shadows = Shadows(even_studio(0.7), vertices.astype(np.float32), faces)
    normals = Rotation.random(50, random_state=1).apply([0, 0, 1]).astype(np.float32)
    light = shadows.irradiance(np.zeros((50, 3), np.float32), normals, (0.0, 0.0, 0.0))
    assert np.abs(light / 0.7 - 1).max() < QUADRATURE


def test_inside_a_closed_ball_it_is_dark_and_outside_it_is_not() -> None:
    vertices, faces = sphere(3)
    vertices = (0.1 * vertices).astype(np.float32)
    shadows = Shadows(even_studio(1.0), vertices, faces)
    inside = (vertices * 0.5).astype(np.float32)
    normals = (vertices * 10).astype(np.float32)
    assert np.abs(shadows.irradiance(inside, normals, (0.0, 0.0, 0.0))).max() == 0
    lit = shadows.irradiance((vertices * 1.001).astype(np.float32), normals, (0.0, 0.0, 0.0))
    assert lit.min() > 0.85  # convex: nothing but the bias at grazing angles is lost


def test_red_light_wraps_furthest() -> None:
    vertices, faces = sphere(1)
    lamp_only = Studio((), (2.0, 2.0, 2.0), (0.0, 0.0, 0.0))
    shadows = Shadows(lamp_only, (vertices * 1e-3 - (0, 5, 0)).astype(np.float32), faces)
    downwards = np.array([[0, -1, 0]], np.float32)
    light = shadows.irradiance(np.zeros((1, 3), np.float32), downwards, (0.4, 0.2, 0.0))[0]
    assert light[0] > light[1] > light[2]


def test_strands_follow_rigidly() -> None:
    rng = np.random.default_rng(2)
    vertices, faces = sphere(1)
    strands = Strands(
        rng.integers(0, len(faces), 5),
        rng.normal(size=(5, 4, 3)),
        np.ones((5, 4)),
        np.ones((5, 4, 3)),
        rng.normal(size=(5, 4, 3)),
        np.ones((5, 4)),
    )
    vertices = vertices.astype(np.float64)
    turn, shift = Rotation.random(random_state=3), np.array([0.3, -0.2, 0.1])
    rest = triangle_frames(vertices, faces)
    points, normals = strands.follow(rest, triangle_frames(turn.apply(vertices) + shift, faces))
    assert np.allclose(points.reshape(-1, 3), turn.apply(strands.points.reshape(-1, 3)) + shift, atol=RIGID_TOLERANCE)
    assert np.allclose(normals.reshape(-1, 3), turn.apply(strands.normals.reshape(-1, 3)), atol=RIGID_TOLERANCE)
