"""Oracles: trimesh's closest points, our own carrying into the world, and a published avatar's bindings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.proximity import closest_point_naive

from sacha_core.animation.splat_binding import bound_to, nearest_binding, subdivided, with_colours_as_harmonics
from sacha_core.animation.standing import Standing
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.splat_ply import read_bound_ply
from sacha_core.raster.harmonics import sh_colours

DISTANCE_ERROR_M = 1e-9  # two formulas in float64
WORLD_ERROR_M = 2e-6  # float32, there and back, some centimetres from the triangle
LOCAL_ERROR = 1e-3  # of a triangle's size, where the smallest has a third of a millimetre: float32 of a place in metres


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


def scattered(head: HeadModel, n: int = 400, seed: int = 0) -> Gaussians:
    """Give Gaussians in the world, round a head."""
    rng = np.random.default_rng(seed)
    gaussians = initial_gaussians(n, rng, sh_degree=1)
    position = head.v_template[rng.integers(head.n_vertices, size=n)] + rng.normal(size=(n, 3), scale=0.02)
    quaternion = rng.normal(size=(n, 4)).astype(np.float32)
    log_scale = rng.normal(size=(n, 3), loc=-5).astype(np.float32)
    return replace(gaussians, position=position.astype(np.float32), quaternion=quaternion, log_scale=log_scale)


@pytest.mark.parametrize("seed", range(3))
def test_nearest_triangles_are_as_near_as_trimesh_says(head: HeadModel, seed: int) -> None:
    points = scattered(head, seed=seed).position.astype(np.float64)
    found, distance = nearest_binding(points, head.v_template, head.faces)
    mesh = Trimesh(head.v_template.astype(np.float64), head.faces, process=False)
    _, expected, _ = closest_point_naive(mesh, points)
    np.testing.assert_allclose(distance, expected, atol=DISTANCE_ERROR_M)
    own = Trimesh(
        mesh.vertices, mesh.faces[np.unique(found)], process=False
    )  # the triangles that were named are so near
    np.testing.assert_allclose(closest_point_naive(own, points)[1], expected, atol=DISTANCE_ERROR_M)


def test_of_several_nearest_the_first() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], np.float32)
    faces = np.array([[0, 2, 3], [0, 1, 2], [0, 3, 4], [0, 4, 1]], np.int32)
    found, distance = nearest_binding(np.array([[0, 0, 0.5], [0.2, 0.2, 0.1], [0.5, 0, 0]]), vertices, faces)
    assert found.tolist() == [0, 1, 1]
    np.testing.assert_allclose(distance, [0.5, 0.1, 0])


@pytest.mark.parametrize("n_faces", [1, 31, 32, 33, 64])
def test_any_number_of_triangles(n_faces: int) -> None:
    rng = np.random.default_rng(n_faces)
    vertices = rng.normal(size=(3 * n_faces, 3)).astype(np.float32)
    faces = np.arange(3 * n_faces, dtype=np.int32).reshape(-1, 3)
    points = rng.normal(size=(50, 3))
    mesh = Trimesh(vertices.astype(np.float64), faces, process=False)
    found, distance = nearest_binding(points, vertices, faces)
    np.testing.assert_allclose(distance, closest_point_naive(mesh, points)[1], atol=DISTANCE_ERROR_M)
    assert found.max() < n_faces
    assert nearest_binding(points[:0], vertices, faces)[0].shape == (0,)


def test_bound_gaussians_stand_where_they_stood(head: HeadModel) -> None:
    world = scattered(head)
    binding, _ = nearest_binding(world.position, head.v_template, head.faces)
    back = Standing(bound_to(world, binding, head.v_template, head.faces), head, None)(0)
    np.testing.assert_allclose(back.position, world.position, atol=WORLD_ERROR_M)
    np.testing.assert_allclose(back.log_scale, world.log_scale, atol=1e-5)
    unit = world.quaternion / np.linalg.norm(world.quaternion, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((back.quaternion * unit).sum(axis=1)), 1, atol=1e-5)
    np.testing.assert_array_equal(back.sh_rest, world.sh_rest)
    np.testing.assert_array_equal(back.binding, binding)


def test_what_is_out_of_reach_is_named(head: HeadModel) -> None:
    world = scattered(head, 3)
    world.position[1] = 3e38
    with pytest.raises(FormatError, match=r"Gaussian 1 at .* is too far from the head"):
        bound_to(world, np.zeros(3, np.int32), head.v_template, head.faces)


def naive_subdivision(faces: np.ndarray) -> tuple[dict[tuple[int, int], int], list[int]]:
    """Subdivide triangle by triangle; give the new vertices, and each vertex's first triangle in PyTorch3D's order."""
    n = int(faces.max()) + 1
    sides = sorted({tuple(sorted((int(f[i]), int(f[(i + 1) % 3])))) for f in faces for i in range(3)})
    middle = {side: n + number for number, side in enumerate(sides)}

    def between(a: int, b: int) -> int:
        return middle[tuple(sorted((int(a), int(b))))]

    blocks = [
        [(f[0], between(f[0], f[1]), between(f[0], f[2])) for f in faces],
        [(f[1], between(f[1], f[2]), between(f[0], f[1])) for f in faces],
        [(f[2], between(f[0], f[2]), between(f[1], f[2])) for f in faces],
        [(between(f[0], f[1]), between(f[1], f[2]), between(f[0], f[2])) for f in faces],
    ]
    first = [-1] * (n + len(middle))
    for block in blocks:
        for number, corners in enumerate(block):
            for corner in corners:
                first[corner] = number if first[corner] < 0 else first[corner]
    return middle, first


def test_subdivision_by_its_definition(head: HeadModel) -> None:
    skin = head.faces[: head.n_faces - head.n_teeth_faces]
    middle, first = naive_subdivision(skin)
    mesh = subdivided(head)
    assert [tuple(edge) for edge in mesh.edges.tolist()] == list(middle)
    assert mesh.binding.tolist() == first
    points = mesh.points(head.v_template)
    assert len(points) == len(mesh.binding)
    for edge, place in list(middle.items())[::97]:
        np.testing.assert_allclose(points[place], head.v_template[list(edge)].mean(axis=0), atol=1e-7)


def test_colours_become_the_harmonics_that_show_them(head: HeadModel) -> None:
    world = replace(scattered(head, 20), sh_dc=np.random.default_rng(0).random((20, 3)).astype(np.float32))
    made = with_colours_as_harmonics(world)
    shown = sh_colours(made.sh_dc, made.sh_rest, made.position, np.array([0, 0, 1.0]), 0)
    np.testing.assert_allclose(shown, world.sh_dc, atol=1e-6)


@pytest.mark.real_data
def test_a_published_avatar_is_bound_as_its_makers_did(real_data: Path) -> None:
    """LAM's mesh and an avatar on it, whose bindings somebody else chose."""
    head, bound = open_head(real_data / "avatar_a_rig.npz"), read_bound_ply(real_data / "avatar_a_bound.ply")
    with np.load(real_data / "avatar_a_rig.npz") as rig:
        mesh = subdivided(head)
        np.testing.assert_allclose(mesh.points(head.v_template), rig["verts_subdiv"], atol=1e-6)
    np.testing.assert_array_equal(mesh.binding, bound.binding)
    world = Standing(bound, head, None)(0)
    again = bound_to(world, mesh.binding, head.v_template, head.faces)
    np.testing.assert_allclose(again.position, bound.position, atol=LOCAL_ERROR)
    np.testing.assert_allclose(again.log_scale, bound.log_scale, atol=1e-5)
