"""Textures of triangles. Oracle: whether a texel's centre lies in a triangle, by trimesh's barycentric coordinates, texel by texel."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sacha_core.errors import OptionError
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.raster.texture import paint_triangles, triangle_map

SIZE = 48
NEAR_EDGE = 1e-9  # barycentric: which side a centre on an edge falls to is a matter of rounding


def inside(uv: np.ndarray, face: int) -> np.ndarray:
    """Give barycentric coordinates' least of each texel's centre in one triangle: (h, w), row 0 at the top."""
    across, down = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    points = np.stack([across / SIZE, 1 - down / SIZE, np.zeros_like(down)], axis=-1).reshape(-1, 3)
    corners = np.repeat(np.pad(uv[face], ((0, 0), (0, 1)))[None], len(points), axis=0)
    return trimesh.triangles.points_to_barycentric(corners, points).min(axis=1).reshape(SIZE, SIZE)


def test_each_texel_shows_the_triangle_that_its_centre_lies_in() -> None:
    rng = np.random.default_rng(2)
    corners = rng.random((6, 3, 2)) * 0.3 + np.array([[[0.02, 0.02]], [[0.35, 0.02]], [[0.67, 0.02]]] * 2)
    corners[3:, :, 1] += 0.5
    labels = triangle_map(corners, SIZE, margin=0)
    for face in range(6):
        least = inside(corners, face)
        sure = np.abs(least) > NEAR_EDGE
        assert ((labels == face) == (least > 0))[sure].all()
        assert (labels == face).any()


def test_the_order_of_corners_does_not_matter_and_the_first_triangle_shows() -> None:
    corners = np.array([[[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]]] * 2)
    corners[1] = corners[1, ::-1]
    labels = triangle_map(corners, SIZE, margin=0)
    assert set(np.unique(labels)) == {-1, 0}
    assert np.array_equal(labels, triangle_map(corners[1:], SIZE, margin=0))


def test_charts_grow_by_the_margin_and_no_further() -> None:
    corners = np.array([[[0.4, 0.4], [0.6, 0.4], [0.5, 0.6]]])
    bare, grown = (triangle_map(corners, SIZE, margin) == 0 for margin in (0, 3))
    rows, columns = np.nonzero(bare)
    every = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij"), axis=-1)
    far = np.abs(every[:, :, None, :] - np.stack([rows, columns], axis=-1)).max(axis=-1).min(axis=-1)
    assert np.array_equal(grown, far <= 3)


def test_a_heads_texture_has_the_colours_of_its_triangles_alone() -> None:
    head = synthetic_head("small")
    colours = np.random.default_rng(1).integers(0, 256, (head.n_faces, 3)).astype(np.uint8)
    uv = head.uv[head.uv_faces]
    painted = paint_triangles(uv, colours, 512, margin=2)
    labels = triangle_map(uv, 512, margin=2)
    assert np.array_equal(painted[..., 3] == 255, labels >= 0)
    assert np.array_equal(painted[labels >= 0, :3], colours[labels[labels >= 0]])
    assert not painted[labels < 0].any()
    centres = uv.mean(axis=1)  # what a renderer meets in the middle of a triangle
    large = np.abs(np.linalg.det(uv[:, 1:] - uv[:, :1])) * 512**2 > 16
    at = np.clip(np.floor(np.stack([(1 - centres[:, 1]), centres[:, 0]], axis=1) * 512).astype(int), 0, 511)
    assert np.array_equal(painted[at[large, 0], at[large, 1], :3], colours[large])
    assert large.sum() > 100


@pytest.mark.parametrize("size", [0, 16385])
def test_sizes_out_of_range_are_refused(size: int) -> None:
    with pytest.raises(OptionError, match="a texture of"):
        triangle_map(np.zeros((1, 3, 2)), size)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_coordinates_that_are_none_are_refused(value: float) -> None:
    with pytest.raises(OptionError, match="not finite or far outside"):
        triangle_map(np.full((1, 3, 2), value), 8)


def test_empty_and_flat_triangles_paint_nothing() -> None:
    assert (triangle_map(np.zeros((0, 3, 2)), 4) == -1).all()
    assert (triangle_map(np.full((2, 3, 2), 0.5), 4) == -1).all()
