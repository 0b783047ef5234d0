"""Unwrapping: the laws of an atlas, held against a plain rasterisation of its triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.flame.synthetic import synthetic_head
from sacha_core.flame.unwrap import unwrapped

SIDE = 512  # texels a side of the picture that triangles are drawn into
EDGE = 1e-3  # barycentric distance to an edge within which neighbours may both claim a texel


@pytest.fixture(scope="module")
def bare():
    return replace(synthetic_head("small"), uv=None, uv_faces=None)


@pytest.fixture(scope="module")
def head(bare):
    return unwrapped(bare)


def claims(uv, uv_faces):
    """Count for each texel the triangles that it lies well inside of (naive loop over triangles)."""
    count = np.zeros((SIDE, SIDE), int)
    for corners in uv[uv_faces].astype(float) * SIDE:
        low, high = np.floor(corners.min(0)).astype(int), np.ceil(corners.max(0)).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        (ax, ay), (bx, by), (cx, cy) = corners
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        s = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
        t = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
        inside = np.minimum(np.minimum(s, t), 1 - s - t) > EDGE
        count[low[1] : high[1], low[0] : high[0]][inside] += 1
    return count


def test_every_triangle_has_its_place_and_none_is_another_s(head):
    assert head.uv_faces.shape == head.faces.shape
    assert head.uv.min() >= 0
    assert head.uv.max() <= 1
    count = claims(head.uv, head.uv_faces)
    assert count.max() == 1, "two triangles share a texel"
    assert count.mean() > 0.4, "less than half of the square is used"


def test_a_coordinate_belongs_to_one_vertex(head):
    """Each row of uv serves corners of one vertex only, so that the atlas is the head's surface cut along seams."""
    owner = np.full(len(head.uv), -1)
    owner[head.uv_faces.ravel()] = head.faces.ravel()
    assert np.array_equal(owner[head.uv_faces], head.faces)


def test_same_head_and_same_coordinates_again(bare, head):
    again = unwrapped(bare)
    assert np.array_equal(again.uv, head.uv)
    assert again.reference == bare.reference
    again.validate()


def test_coordinates_of_its_own_are_kept():
    head = synthetic_head("small")
    assert unwrapped(head) is head
