"""Oracles: the published table in its own words; laws of mirror symmetry, orientation and closed seams."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.motion import Motion
from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.teeth import LOWER_LIP, UPPER_LIP, add_teeth, is_flame, teeth_faces
from sacha_core.geometry.triangle import triangle_frames

ROUNDING_32 = 1e-6

# Rows: R root, E edge, B root back, D edge back, by first vertex; then triangles of column n for n < 7, and for n >= 7.
TABLE = (
    ({"R": 0, "E": 30}, "R n, E n+1, E n; R n, R n+1, E n+1", "R n, R n+1, E n; R n+1, E n+1, E n"),
    ({"B": 60, "D": 75}, "B n, D n, D n+1; B n, D n+1, B n+1", "B n, D n, B n+1; B n+1, D n, D n+1"),
    ({"D": 75, "E": 30}, "D n, E n, D n+1; D n+1, E n, E n+1", "D n, E n, E n+1; D n, E n+1, D n+1"),
    ({"E": 45, "R": 15}, "E n, E n+1, R n; E n+1, R n+1, R n", "E n, R n+1, R n; E n, E n+1, R n+1"),
    ({"B": 90, "D": 105}, "B n, D n+1, D n; B n, B n+1, D n+1", "B n, B n+1, D n; B n+1, D n+1, D n"),
    ({"D": 105, "E": 45}, "D n, D n+1, E n; D n+1, E n+1, E n", "D n, E n+1, E n; D n, D n+1, E n+1"),
)


def table_faces() -> list[list[int]]:
    faces = []
    for rows, left, right in TABLE:
        for n in range(14):
            for triangle in (left if n < 7 else right).split("; "):
                corners = [corner.split() for corner in triangle.split(", ")]
                faces.append([rows[row] + n + (column == "n+1") for row, column in corners])
    return faces


@pytest.fixture(scope="module")
def bare() -> HeadModel:
    """FLAME's counts over random numbers, but lips that face forward, left to right, one above the other."""
    rng = np.random.default_rng(0)
    v, joints = 5023, 5
    template = rng.normal(size=(v, 3)).astype(np.float32)
    x = np.linspace(0.024, -0.024, 15)
    bow = 0.05 - 8 * x**2
    template[list(UPPER_LIP)] = np.stack([x, np.full(15, 0.004), bow], axis=1)
    template[list(LOWER_LIP)] = np.stack([x, np.full(15, -0.004), bow - 0.002], axis=1)
    weights = rng.random((v, joints))
    return HeadModel(
        name="bare",
        v_template=template,
        faces=np.sort(rng.integers(v, size=(9976, 3)), axis=1).astype(np.int32),
        shapedirs=rng.normal(size=(v, 3, 4)).astype(np.float32) / 100,
        exprdirs=rng.normal(size=(v, 3, 3)).astype(np.float32) / 100,
        J_regressor=np.full((joints, v), 1 / v, np.float32),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1], np.int32),
        posedirs=rng.normal(size=(v, 3, 36)).astype(np.float32) / 100,
        uv=rng.random((10, 2)).astype(np.float32) * 0.9,
        uv_faces=rng.integers(10, size=(9976, 3)).astype(np.int32),
    )


def test_triangles_are_the_published_table() -> None:
    np.testing.assert_array_equal(teeth_faces(), table_faces())


def test_counts_and_order(bare: HeadModel) -> None:
    head = add_teeth(bare)
    head.validate()
    assert (head.n_vertices, head.n_faces, head.n_teeth_faces) == (5143, 10144, 168)
    assert is_flame(bare)
    assert is_flame(head)
    np.testing.assert_array_equal(head.faces[:9976], bare.faces)
    np.testing.assert_array_equal(head.faces[9976:], np.array(table_faces()) + 5023)
    np.testing.assert_array_equal(head.v_template[:5023], bare.v_template)
    assert head.uv is not None
    assert len(np.unique(head.uv[10:], axis=0)) == 120


def test_places_in_terms_of_the_lips(bare: HeadModel) -> None:
    upper, lower = bare.v_template[list(UPPER_LIP)], bare.v_template[list(LOWER_LIP)]
    gap = np.linalg.norm(upper - lower, axis=1).mean()
    rows = add_teeth(bare).v_template[5023:].reshape(8, 15, 3)
    middle = (upper + lower) / 2
    height, depth = middle[:, 1].mean(), middle[:, 2] - 1.5 * gap
    expected = {
        0: (2.1, 0),
        1: (-2.1, -0.4),
        2: (0.1, 0),
        3: (-0.1, -0.4),
        4: (2.1, -1),
        5: (0.1, -1),
        6: (-2.1, -1.4),
        7: (-0.1, -1.4),
    }
    for row, (up, forward) in expected.items():
        np.testing.assert_allclose(rows[row, :, 0], middle[:, 0], atol=ROUNDING_32)
        np.testing.assert_allclose(rows[row, :, 1], height + up * gap, atol=ROUNDING_32)
        np.testing.assert_allclose(rows[row, :, 2], depth + forward * gap, atol=ROUNDING_32)


def test_surfaces_face_outwards(bare: HeadModel) -> None:
    head = add_teeth(bare)
    normals = triangle_frames(head.v_template, head.faces[9976:]).rotation[:, :, 1].reshape(6, 28, 3)
    for strip, (axis, sign) in enumerate([(2, 1), (2, -1), (1, -1), (2, 1), (2, -1), (1, 1)]):
        assert (sign * normals[strip, :, axis] > 0).all(), strip


def test_mirroring_the_columns_mirrors_the_triangles() -> None:
    faces = teeth_faces()
    mirrored = (faces // 15 * 15 + 14 - faces % 15)[:, ::-1]

    def canonical(triangles: np.ndarray) -> set[tuple[int, ...]]:
        return {tuple(np.roll(triangle, -int(np.argmin(triangle)))) for triangle in triangles}

    assert canonical(mirrored) == canonical(faces)


def test_inner_edges_are_used_once_in_each_direction() -> None:
    for jaw in (teeth_faces()[:84], teeth_faces()[84:]):
        directed = Counter((int(t[i]), int(t[(i + 1) % 3])) for t in jaw for i in range(3))
        assert max(directed.values()) == 1
        open_edges = [edge for edge in directed if edge[::-1] not in directed]
        assert len(open_edges) == 2 * 14 + 2 * 3  # both roots, and three strips at either end


def moved_by(head: HeadModel, **pose: np.ndarray) -> np.ndarray:
    """Tell which teeth vertices a pose moves, by row of 15."""
    rest = Motion.rest(4, 3)
    before, after = (Poser(head, motion, np.float64)(0)[5023:] for motion in (rest, replace(rest, **pose)))
    return (np.abs(after - before) > 1e-9).any(axis=1).reshape(8, 15)


def test_lower_teeth_move_with_the_jaw_and_upper_ones_do_not(bare: HeadModel) -> None:
    moved = moved_by(add_teeth(bare), jaw=np.array([[0.3, 0, 0]], np.float32))
    assert moved[[1, 3, 6, 7]].all()
    assert not moved[[0, 2, 4, 5]].any()


def test_all_teeth_move_with_the_neck_and_none_with_eyes_or_expression(bare: HeadModel) -> None:
    head = add_teeth(bare)
    assert moved_by(head, neck=np.array([[0, 0.2, 0]], np.float32)).all()
    assert not moved_by(head, eyes=np.full((1, 6), 0.3, np.float32)).any()
    rest = Motion.rest(4, 3)
    smile = replace(rest, expression=np.ones((1, 3), np.float32))
    poser = [Poser(head, motion, np.float64)(0)[5023:] for motion in (rest, smile)]
    np.testing.assert_allclose(poser[1], poser[0], atol=1e-7)


def test_identity_moves_each_column_as_the_lips_in_front(bare: HeadModel) -> None:
    directions = add_teeth(bare).shapedirs
    expected = (directions[list(UPPER_LIP)] + directions[list(LOWER_LIP)]) / 2
    np.testing.assert_allclose(
        directions[5023:].reshape(8, 15, 3, 4), np.broadcast_to(expected, (8, 15, 3, 4)), atol=ROUNDING_32
    )


def test_heads_that_take_no_teeth(bare: HeadModel, random_head: HeadModel) -> None:
    with pytest.raises(HeadError, match="'random' has 30, 40, and 0 teeth triangles"):
        add_teeth(random_head)
    with pytest.raises(HeadError, match="'bare' has 5143, 10144, and 168 teeth triangles"):
        add_teeth(add_teeth(bare))
    jawless = replace(
        bare, parents=bare.parents[:2], weights=bare.weights[:, :2], J_regressor=bare.J_regressor[:2], posedirs=None
    )
    with pytest.raises(HeadError, match="teeth need a jaw to move with; head 'bare' has 2 joints"):
        add_teeth(jawless)
