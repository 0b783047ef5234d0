"""Oracles: the definition as a naive float64 loop; laws of rigid motion and scaling; right triangles by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sacha_core.errors import GeometryError
from sacha_core.geometry.triangle import triangle_frames

ROUNDING_64 = 1e-11  # corners of 0.01 rad amplify float64 rounding a hundredfold in the normal
ROUNDING_32 = 2e-4  # the same corners in float32
SHARPEST_CORNER_SIN = 1e-2  # the random triangles are at least this far from degenerate


def random_mesh(seed: int, n_faces: int = 300) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(100, 3))
    faces = np.array([rng.choice(100, 3, replace=False) for _ in range(4 * n_faces)])
    e, h = vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    sine = np.linalg.norm(np.cross(e, h), axis=1) / np.linalg.norm(e, axis=1) / np.linalg.norm(h, axis=1)
    return vertices, faces[sine > SHARPEST_CORNER_SIN][:n_faces]


def naive_frame(v0: np.ndarray, v1: np.ndarray, v2: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    first = (v1 - v0) / np.linalg.norm(v1 - v0)
    normal = np.cross(first, v2 - v0)
    normal /= np.linalg.norm(normal)
    third = -np.cross(normal, first)
    scale = (np.linalg.norm(v1 - v0) + abs(third @ (v2 - v0))) / 2
    return np.stack([first, normal, third], axis=1), scale, (v0 + v1 + v2) / 3


def test_against_the_definition_face_by_face() -> None:
    vertices, faces = random_mesh(0)
    frames = triangle_frames(vertices, faces)
    for i, face in enumerate(faces):
        rotation, scale, origin = naive_frame(*vertices[face])
        np.testing.assert_allclose(frames.rotation[i], rotation, atol=ROUNDING_64)
        np.testing.assert_allclose(frames.scale[i], scale, rtol=ROUNDING_64)
        np.testing.assert_allclose(frames.origin[i], origin, atol=ROUNDING_64)


def test_a_right_triangle_by_hand() -> None:
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 4, 0]])
    frames = triangle_frames(vertices, np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(frames.rotation[0], np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]))
    assert frames.scale[0] == 3
    np.testing.assert_allclose(frames.origin[0], [2 / 3, 4 / 3, 0])


def test_proper_normal_second_and_third_axis_away_from_the_third_vertex() -> None:
    vertices, faces = random_mesh(1)
    frames = triangle_frames(vertices, faces)
    v0, v1, v2 = (vertices[faces[:, i]] for i in range(3))
    np.testing.assert_allclose(np.linalg.det(frames.rotation), 1, atol=ROUNDING_64)
    np.testing.assert_allclose(
        frames.rotation.transpose(0, 2, 1) @ frames.rotation,
        np.broadcast_to(np.eye(3), (len(faces), 3, 3)),
        atol=ROUNDING_64,
    )
    assert (np.einsum("ni,ni->n", frames.rotation[:, :, 1], np.cross(v1 - v0, v2 - v0)) > 0).all()
    assert (np.einsum("ni,ni->n", frames.rotation[:, :, 2], v2 - v0) < 0).all()
    assert (frames.scale > 0).all()


@given(st.integers(0, 10**6), st.floats(0.01, 100))
def test_frames_follow_similarities_of_the_mesh(seed: int, factor: float) -> None:
    vertices, faces = random_mesh(2, 50)
    rng = np.random.default_rng(seed)
    turn, move = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    before, after = triangle_frames(vertices, faces), triangle_frames(factor * vertices @ turn.T + move, faces)
    np.testing.assert_allclose(after.rotation, turn @ before.rotation, atol=100 * ROUNDING_64)
    np.testing.assert_allclose(after.scale, factor * before.scale, rtol=100 * ROUNDING_64)
    np.testing.assert_allclose(after.origin, factor * before.origin @ turn.T + move, atol=100 * ROUNDING_64)


def test_float32_agrees_with_its_own_float64() -> None:
    vertices, faces = random_mesh(3)
    single_vertices = vertices.astype(np.float32)
    single, double = triangle_frames(single_vertices, faces), triangle_frames(single_vertices.astype(np.float64), faces)
    for name in ("rotation", "scale", "origin"):
        assert getattr(single, name).dtype == np.float32
        np.testing.assert_allclose(getattr(single, name), getattr(double, name), rtol=ROUNDING_32, atol=ROUNDING_32)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    "third",
    [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), (3, 3, 3), (1 / 3, 1 / 3, 1 / 3), (-7.7, -7.7, -7.7)],
    ids=["repeats first", "repeats second", "between", "beyond", "third of the way", "before"],
)
def test_zero_area_names_the_first_such_face(dtype: type, third: tuple[float, float, float]) -> None:
    vertices = np.array([[0, 0, 0], [1, 1, 1], third, [0, 1, 0]], dtype)
    with pytest.raises(GeometryError, match="triangle 1 has zero area"):
        triangle_frames(vertices, np.array([[0, 1, 3], [0, 1, 2], [1, 0, 2]]))


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_a_vertex_that_is_not_finite_is_named(poison: float) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, poison]], np.float32)
    with (
        np.errstate(invalid="ignore"),
        pytest.raises(GeometryError, match="triangle 1 has a vertex that is not finite"),
    ):
        triangle_frames(vertices, np.array([[0, 1, 2], [0, 1, 3]]))


def test_small_triangles_in_float32_are_not_degenerate() -> None:
    vertices = np.array([[0.1, 1.6, 0.1], [0.1004, 1.6, 0.1], [0.1, 1.6004, 0.1]], np.float32)
    assert abs(triangle_frames(vertices, np.array([[0, 1, 2]])).scale[0] - 4e-4) < 1e-6


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_vanishing_triangle_keeps_its_shape_until_it_is_refused(dtype: type) -> None:
    """Shrunk by powers of two, which round nothing, a triangle keeps its rotation to the bit; then squares would underflow."""
    vertices = np.array([[0, 0, 0], [3, 1, 2], [1, 4, -2]], dtype) / 4
    expected = triangle_frames(vertices, np.array([[0, 1, 2]]))
    smallest = float(np.finfo(dtype).tiny) ** 0.25  # of an edge whose square times another's is still a normal number
    refused = 0
    for halvings in range(0, 1200, 3):
        size = dtype(2.0) ** dtype(-halvings)
        try:
            frames = triangle_frames(vertices * size, np.array([[0, 1, 2]]))
        except GeometryError:
            refused += 1
            assert size < smallest
            continue
        assert not refused
        np.testing.assert_array_equal(frames.rotation, expected.rotation)
        np.testing.assert_array_equal(frames.scale, expected.scale * size)
    assert refused


@pytest.mark.parametrize("size", [1e-15, 1e15])
def test_a_triangle_out_of_range_is_not_said_to_have_no_area(size: float) -> None:
    vertices = (np.array([[0, 0, 0], [3, 1, 2], [1, 4, -2]]) * size).astype(np.float32)
    with pytest.raises(GeometryError, match=r"triangle 0 has an edge of 3\.74e[+-]15 m, out of range for float32"):
        triangle_frames(vertices, np.array([[0, 1, 2]]))


def test_no_faces() -> None:
    assert triangle_frames(np.zeros((3, 3)), np.zeros((0, 3), np.int32)).rotation.shape == (0, 3, 3)
