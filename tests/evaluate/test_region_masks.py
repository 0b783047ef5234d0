"""Which region each pixel shows. Oracles: rays in float64, and meshes whose picture is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.errors import HeadError
from sacha_core.evaluate.region_masks import NOWHERE, RegionMasks, close_openings
from sacha_core.flame.posing import Poser
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER

ON_AN_EDGE = (
    0.02  # of the pixels: vertices are rounded to 1/256 pixel, so rays close to an edge may meet its other side
)


def first_hits(vertices: np.ndarray, faces: np.ndarray, camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cast a ray through each pixel's centre: the nearest triangle (-1 for none), and whether it is met from behind.

    Source: Moeller and Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
    """
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    normal = np.cross(b - a, c - a)
    nearest, behind = np.full(len(pixels), -1), np.zeros(len(pixels), bool)
    for row, (y, x) in enumerate(pixels):
        ray = np.array([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0]) @ camera.rotation
        p = np.cross(ray, c - a)
        det = np.einsum("fi,fi->f", p, b - a)
        s = camera.centre - a
        q = np.cross(s, b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = np.einsum("fi,fi->f", p, s) / det, q @ ray / det
            depth = np.einsum("fi,fi->f", q, c - a) / det
        hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (depth > 0.1)
        if hit.any():
            nearest[row] = np.argmin(np.where(hit, depth, np.inf))
            behind[row] = normal[nearest[row]] @ ray > 0
    return nearest, behind


def test_against_rays(subject) -> None:
    masks = RegionMasks(subject.capture, subject.head)
    labels = label_triangles(subject.head)
    rng = np.random.default_rng(0)
    for view in (subject.capture.val[0], subject.capture.test[0]):
        camera = view.camera.resized(96, 140)
        mask = masks.region_of_pixel(view, 96, 140)
        pixels = rng.integers(0, mask.shape, (600, 2))
        vertices = Poser(subject.head, subject.motion)(view.timestep)
        nearest, behind = first_hits(vertices, subject.head.faces, camera, pixels)
        expected = np.where(nearest < 0, NOWHERE, labels[nearest])
        found = mask[pixels[:, 0], pixels[:, 1]]
        assert 0.1 < (expected != NOWHERE).mean() < 0.95
        assert np.mean((found != expected) & ~behind) < ON_AN_EDGE
        assert len(set(expected)) > 5


def test_an_open_mouth_of_a_mesh_without_a_cavity_is_mouth(subject) -> None:
    """Without its teeth and whatever lies behind the lips, the hole between them still shows no neck."""
    head, view = subject.head, subject.capture.val[0]
    jaw = subject.motion.jaw.copy()
    jaw[:, 0] = 0.4
    capture = replace(subject.capture, motion=replace(subject.motion, jaw=jaw, neck=0 * subject.motion.neck))
    lips = label_triangles(head) == PAPER.label("mouth")
    masks = RegionMasks(capture, head)
    mouth = np.argwhere(masks.region_of_pixel(view, 192, 280) == PAPER.label("mouth"))
    assert lips.any()
    (top, left), (bottom, right) = mouth.min(axis=0), mouth.max(axis=0)
    middle = masks.region_of_pixel(view, 192, 280)[(top + bottom) // 2, (left + right) // 2]
    assert PAPER.regions[middle] == "mouth"


def test_openings_take_what_surrounds_them() -> None:
    mask = np.full((9, 12), NOWHERE, np.uint8)
    mask[1:8, 1:8] = 3
    mask[3:6, 3:6] = 5  # the back of the head, seen through a hole in region 3
    mask[7, 8:11] = 6  # and an edge seen from behind beside the background
    inside = (mask == 5) | (mask == 6)
    expected = mask.copy()
    expected[3:6, 3:6] = 3
    expected[7, 8:11] = 3
    close_openings(mask, inside)
    np.testing.assert_array_equal(mask, expected)
    alone = np.full((4, 4), 2, np.uint8)
    close_openings(alone, np.ones((4, 4), bool))
    assert (alone == NOWHERE).all(), "nothing surrounds it"


def test_masks_are_drawn_once_at_each_size_and_kept(subject) -> None:
    masks = RegionMasks(subject.capture, subject.head)
    view = subject.capture.val[0]
    once = masks.region_of_pixel(view)
    assert masks.region_of_pixel(view) is once
    assert once.shape == (view.camera.height, view.camera.width)
    assert masks.region_of_pixel(view, 24, 35).shape == (35, 24)
    assert masks.region_of_pixel(subject.capture.val[1]) is not once
    with pytest.raises(ValueError, match="read-only"):
        once[0, 0] = 1


def test_a_head_without_masks_is_refused(subject) -> None:
    with pytest.raises(HeadError, match="no vertex mask"):
        RegionMasks(subject.capture, replace(subject.head, masks={}))
