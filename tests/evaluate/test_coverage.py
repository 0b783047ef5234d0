"""Is the tracked head where the images show it? Oracle: projecting vertex by vertex; a capture of the very head."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sacha_core.errors import DatasetError
from sacha_core.evaluate.coverage import foreground, mesh_coverage, pixels_of
from sacha_core.flame.posing import Poser


def test_a_head_lies_inside_its_own_masks(subject) -> None:
    views = (*subject.capture.train, *subject.capture.test)
    found = mesh_coverage(subject.capture, subject.head, views, [foreground(subject.capture, view) for view in views])
    assert len(found) == len(views)
    for one in found:
        assert one.inside > 0.85  # the masks are where half of the light is held, vertices reach a little beyond
        assert one.in_image == 1
        assert 0.05 < one.mask_area < 0.95


def test_a_head_tracked_elsewhere_is_noticed(subject) -> None:
    moved = replace(subject.motion, translation=subject.motion.translation + np.float32([0.2, 0, 0]))
    views = subject.capture.val
    masks = [foreground(subject.capture, view) for view in views]
    found = mesh_coverage(replace(subject.capture, motion=moved), subject.head, views, masks)
    assert max(one.inside for one in found) < 0.6


def test_projection_against_one_vertex_at_a_time(subject) -> None:
    view = subject.capture.train[0]
    camera = view.camera
    vertices = Poser(subject.head, subject.motion)(view.timestep).copy()
    vertices[0] = camera.centre + camera.rotation.T @ (0.0, 0.0, -1.0)  # behind the camera
    vertices[1] = camera.centre + camera.rotation.T @ (5.0, 0.0, 1.0)  # far to the right of the image
    row, column, in_image = pixels_of(vertices, camera)
    pixels = iter(zip(row, column, strict=True))
    for index, vertex in enumerate(vertices.astype(np.float64)):
        x, y, z = camera.rotation @ vertex + camera.translation
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside = z > 0 and 0 <= u < camera.width and 0 <= v < camera.height
        assert in_image[index] == inside
        if inside:
            assert next(pixels) == (int(v), int(u))
    assert next(pixels, None) is None
    assert not in_image[:2].any()


def test_without_masks_whatever_is_not_white_counts(subject) -> None:
    view = subject.capture.val[0]
    dark = foreground(subject.capture, replace(view, mask_path=None))
    mask = foreground(subject.capture, view)
    assert (mask & ~dark).mean() < 0.02
    assert (dark & ~mask).mean() < 0.2


def test_grey_masks_count_from_the_middle(subject, tmp_path) -> None:
    view = subject.capture.val[0]
    grey = np.zeros((view.camera.height, view.camera.width), np.uint8)
    grey[:10], grey[10:20] = 128, 127
    Image.fromarray(grey).save(tmp_path / "grey.png")
    found = foreground(subject.capture, replace(view, mask_path=tmp_path / "grey.png"))
    np.testing.assert_array_equal(found, grey == 128)


def cut(picture: bytes) -> bytes:
    return picture[:60]


def boundless(picture: bytes) -> bytes:
    """Promise more pixels than anyone has memory for: a PNG's first chunk starts with width and height and ends with its checksum."""
    first = b"IHDR" + struct.pack(">II", 100_000, 100_000) + picture[24:29]
    return picture[:12] + first + struct.pack(">I", zlib.crc32(first)) + picture[33:]


@pytest.mark.parametrize("broken_by", [cut, boundless])
def test_a_broken_mask_is_named(subject, tmp_path, broken_by) -> None:
    view = subject.capture.val[0]
    broken = tmp_path / "broken.png"
    broken.write_bytes(broken_by(view.mask_path.read_bytes()))
    with pytest.raises(DatasetError, match=r"broken\.png"):
        foreground(subject.capture, replace(view, mask_path=broken))
