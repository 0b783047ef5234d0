"""The triangle rasteriser against rays in float64, and that meshes without holes are drawn without holes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.raster.camera import Camera
from sacha_core.synthesis.kernels.surface import SUBPIXEL_BITS, project, widen_strands
from sacha_core.synthesis.kernels.triangles import rasterise

# Vertices are rounded to 1/256 pixel, so an edge moves by at most half of that along each axis: sqrt(2) / 512 pixel, rounded up.
EDGE_BAND_PX = 0.003
# The same rounding moves the plane of a triangle; on triangles at least a few pixels wide and 0.3 m deep that is below 1 mm of depth.
DEPTH_BAND_M = 1e-3
DEPTH_TOLERANCE = 2e-3  # relative, for the same reason
NEAR = 0.1


def draw(points: np.ndarray, faces: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    screen = np.zeros((len(points), 2), np.int32)
    inverse_depth = np.zeros(len(points), np.float32)
    lens = (camera.rotation, camera.translation, camera.fx, camera.fy, camera.cx, camera.cy, NEAR)
    project(points.astype(np.float32), *lens, screen, inverse_depth)
    ids = np.full((camera.height, camera.width), -1, np.int32)
    depth = np.zeros((camera.height, camera.width), np.float32)
    rasterise(screen, inverse_depth, faces.astype(np.int32), 0, ids, depth)
    return ids, depth


def cast_rays(points: np.ndarray, faces: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each pixel: depth along the axis of each triangle (inf where missed), and the smallest distance in pixels to any edge.

    Source: Moeller and Trumbore, Fast, minimum storage ray/triangle intersection, 1997; edge distances in the image plane.
    """
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
    rays = local @ camera.rotation  # camera to world; unit depth
    depths = np.full((len(faces), *u.shape), np.inf)
    edge = np.full(u.shape, np.inf)
    for f, face in enumerate(faces):
        a, b, c = points[face].astype(np.float64)
        p = np.cross(rays, c - a)
        det = p @ (b - a)
        s = camera.centre - a
        q = np.cross(s, b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second, depth = p @ s / det, rays @ q / det, (q @ (c - a)) / det
        hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (depth > NEAR)
        depths[f][hit] = depth[hit]
        image = points[face] @ camera.rotation.T + camera.translation
        corners = image[:, :2] / image[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        for i in range(3):
            start, along = corners[i], corners[(i + 1) % 3] - corners[i]
            t = np.clip(((u - start[0]) * along[0] + (v - start[1]) * along[1]) / (along @ along), 0, 1)
            edge = np.minimum(edge, np.hypot(u - start[0] - t * along[0], v - start[1] - t * along[1]))
    return depths, rays, edge


@pytest.mark.parametrize("seed", range(4))
def test_against_rays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.25, 0.25, (24, 3))
    faces = rng.permutation(24).reshape(8, 3)
    camera = Camera.look_at(np.array([0.3, 0.2, 1.0]), np.zeros(3), 60, 44, 90.0)
    camera = replace(camera, cx=28.3, cy=23.1, fy=84.0)
    ids, inverse = draw(points, faces, camera)
    depths, _, edge = cast_rays(points.astype(np.float32).astype(np.float64), faces, camera)
    nearest = np.sort(depths, axis=0)
    expected = np.where(np.isfinite(nearest[0]), np.argmin(depths, axis=0), -1)
    with np.errstate(invalid="ignore"):
        doubtful = (edge < EDGE_BAND_PX) | (nearest[1] - nearest[0] < DEPTH_BAND_M)
    assert (expected >= 0).mean() > 0.1, "the picture shows something"
    assert doubtful.mean() < 0.05, "and the band hides little of it"
    assert np.array_equal(ids[~doubtful], expected[~doubtful])
    seen = ~doubtful & (expected >= 0)
    assert np.abs(inverse[seen] * nearest[0][seen] - 1).max() < DEPTH_TOLERANCE
    assert np.all(inverse[ids < 0] == 0)


@pytest.mark.parametrize("seed", range(3))
def test_a_sheet_has_no_gaps(seed: int) -> None:
    """A triangulated sheet that covers the picture covers every sample, whichever way its shared edges run."""
    rng = np.random.default_rng(seed)
    n = 40
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    points += rng.uniform(-0.3, 0.3, points.shape) * (2 / n, 2 / n, 1)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    halves = np.stack([corner, corner + 1, corner + n, corner + 1, corner + n, corner + n + 1], axis=1).reshape(-1, 3)
    faces = np.array([rng.permutation(face) for face in halves])
    camera = Camera.look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), 150, 130, 200.0)
    ids, _ = draw(points, faces, camera)
    assert (ids >= 0).all()


def test_order_of_triangles_matters_only_for_ties() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.25, 0.25, (60, 3))
    faces = rng.permutation(60).reshape(20, 3)
    camera = Camera.look_at(np.array([0.0, 0.1, 1.0]), np.zeros(3), 50, 50, 90.0)
    order = rng.permutation(20)
    ids, depth = draw(points, faces, camera)
    shuffled, same_depth = draw(points, faces[order], camera)
    assert np.array_equal(depth, same_depth)
    named = np.where(shuffled >= 0, order[shuffled], -1)
    assert (named != ids).mean() < 0.001  # two triangles at exactly one float32 depth


def test_what_is_behind_or_beside_is_not_drawn() -> None:
    camera = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), 20, 20, 30.0)
    behind = np.array([[-0.1, -0.1, 1.5], [0.1, -0.1, 1.5], [0.0, 0.1, 1.5]])
    across = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 1.2]])  # one vertex behind the camera
    beside = np.array([[5.0, 0.0, 0.0], [5.1, 0.0, 0.0], [5.0, 0.1, 0.0]])
    flat = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.0], [0.2, 0.2, 0.0]])
    for triangle in (behind, across, beside, flat):
        ids, _ = draw(triangle, np.array([[0, 1, 2]]), camera)
        assert (ids == -1).all()


def test_strands_are_as_wide_as_they_are() -> None:
    """A straight strand across the view: its ribbon's two sides are twice its radius apart, and at a right angle to it."""
    camera = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), 400, 400, 800.0)
    points = np.array([[-0.1, -0.05, 0.0], [0.0, 0.0, 0.0], [0.1, 0.05, 0.0]], np.float32)
    radii = np.array([0.004, 0.003, 0.001], np.float32)
    screen, inverse_depth = np.zeros((6, 2), np.int32), np.zeros(6, np.float32)
    lens = (camera.rotation, camera.translation, camera.fx, camera.fy, camera.cx, camera.cy, NEAR)
    widen_strands(points, radii, 3, *lens, screen, inverse_depth)
    sides = screen.reshape(3, 2, 2) / (1 << SUBPIXEL_BITS)
    across = sides[:, 0] - sides[:, 1]
    rounding = 2 * EDGE_BAND_PX
    assert np.allclose(np.linalg.norm(across, axis=1), 2 * radii * 800, atol=rounding)
    along = np.array([0.1, -0.05])  # image y points down
    assert np.abs(across @ along / np.linalg.norm(along)).max() < rounding
    assert np.allclose(sides.mean(axis=1), np.array([[120, 240], [200, 200], [280, 160]]), atol=rounding)
    assert np.allclose(inverse_depth, 1.0)
