"""Arrays into meshes: axes, order, and Blender's silent refusals made loud."""

from __future__ import annotations

from types import ModuleType

import bpy
import numpy as np
import pytest
from conftest import corner_colours, face_attribute, positions, triangles


@pytest.fixture
def bridge(addon: ModuleType) -> ModuleType:
    return __import__(f"{addon.__name__}.bridge", fromlist=["new_mesh"])


@pytest.fixture
def square(bridge: ModuleType) -> bpy.types.Mesh:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    return bridge.new_mesh("square", corners, np.array([[0, 1, 2], [0, 2, 3]]))


def test_up_and_forward_become_blenders(bridge: ModuleType) -> None:
    left, up, forward = np.eye(3, dtype=np.float32)
    assert np.array_equal(bridge.to_blender(np.stack([left, up, forward])), [[1, 0, 0], [0, 0, 1], [0, -1, 0]])


def test_the_change_of_axes_is_a_rotation_and_is_undone_exactly(bridge: ModuleType) -> None:
    assert np.linalg.det(bridge.to_blender(np.eye(3, dtype=np.float32))) == 1
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    assert np.array_equal(bridge.to_engine(bridge.to_blender(points)), points)


def test_faces_keep_order_and_direction(square: bpy.types.Mesh) -> None:
    assert triangles(square).tolist() == [[0, 1, 2], [0, 2, 3]]
    assert positions(square).tolist() == [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    assert tuple(square.polygons[0].normal) == (0, -1, 0)  # +z of the engine faces the viewer, as -y does in Blender


def test_numbers_are_stored_as_they_are(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    values = np.array([-7, 2**31 - 1])
    bridge.face_numbers(square, "number", values)
    assert np.array_equal(face_attribute(square, "number"), values)


def test_colours_of_a_face_are_its_corners_and_stay_float(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    colours = np.array([[1 / 3, 0.1, 0.7, 1], [0, 1, 1e-6, 1]], np.float32)
    bridge.corner_colours(square, "hue", colours)
    assert np.array_equal(corner_colours(square, "hue"), np.repeat(colours[:, None], 3, axis=1))


def test_texture_coordinates_belong_to_corners(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    uv = np.random.default_rng(1).random((2, 3, 2)).astype(np.float32)
    bridge.texture_coordinates(square, "uv", uv)
    stored = np.empty(12, np.float32)
    square.uv_layers["uv"].uv.foreach_get("vector", stored)
    assert np.array_equal(stored.reshape(2, 3, 2), uv)


def test_the_colours_shown_are_also_those_rendered(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    for name in ("one", "two"):
        bridge.corner_colours(square, name, np.ones((2, 4)))
    bridge.show_colours(square, "two")
    assert square.color_attributes.active_color.name == "two"
    assert square.color_attributes[square.color_attributes.render_color_index].name == "two"


@pytest.mark.parametrize("name", ["n" * 64, "ü" * 32])
def test_a_name_that_blender_would_drop_is_refused(bridge: ModuleType, square: bpy.types.Mesh, name: str) -> None:
    with pytest.raises(ValueError, match="longer than Blender's 63 bytes"):
        bridge.face_numbers(square, name, np.zeros(2, int))


def test_the_longest_name_is_kept(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    bridge.face_numbers(square, "n" * 63, np.array([3, 4]))
    assert face_attribute(square, "n" * 63).tolist() == [3, 4]


def test_too_few_values_are_refused(bridge: ModuleType, square: bpy.types.Mesh) -> None:
    with pytest.raises(ValueError, match="no FACE attribute 'short' of 1 values"):
        bridge.face_numbers(square, "short", np.zeros(1, int))


def test_triangles_that_blender_drops_are_refused_and_leave_nothing(bridge: ModuleType) -> None:
    corners = np.eye(3, dtype=np.float32)
    with pytest.raises(ValueError, match="keeps only 1 of the 2 triangles"):
        bridge.new_mesh("folded", corners, np.array([[0, 1, 2], [0, 1, 1]]))
    assert "folded" not in bpy.data.meshes
