"""Masks, backgrounds, folders that are no capture, and the picture of the track."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.evaluate.checkup.layout import guess_folder
from sacha_core.evaluate.checkup.overlay import MASK_COLOUR, facing_edges, over_image, write_overlay
from sacha_core.evaluate.checkup.pictures import judge_cameras_of_file, judge_masks
from sacha_core.evaluate.coverage import foreground
from sacha_core.flame.posing import Poser


def with_mask(view, path: Path, value: int):
    Image.fromarray(np.full((view.camera.height, view.camera.width), value, np.uint8)).save(path)
    return replace(view, mask_path=path)


def test_masks_of_nothing_and_of_everything(framed, tmp_path) -> None:
    view = framed.capture.train[0]
    (empty,), masks = judge_masks(framed.capture, [with_mask(view, tmp_path / "e.png", 0), view])
    assert (empty.severity, empty.about) == ("warning", "masks")
    assert "1 of 2 views has next to nothing" in empty.what
    assert [mask.any() for mask in masks] == [False, True]
    (full,), _ = judge_masks(framed.capture, [with_mask(view, tmp_path / "f.png", 255)])
    assert full.severity == "error"


def test_without_masks_the_background_must_be_white(framed, tmp_path) -> None:
    bare = tuple(replace(view, mask_path=None) for view in framed.capture.train)
    capture = replace(framed.capture, train=bare, val=(), test=())
    assert not judge_masks(capture, bare)[0]
    grey = tmp_path / "grey.png"
    Image.new("RGB", (bare[0].camera.width, bare[0].camera.height), (90, 120, 90)).save(grey)
    dirty = (replace(bare[0], image_path=grey), *bare[1:])
    found = judge_masks(replace(capture, train=dirty), dirty)[0]
    assert [(finding.severity, finding.about) for finding in found] == [("error", "masks")] * 2
    assert "the background is not white" in found[0].what
    assert str(grey) in found[0].what


def test_a_principal_point_far_from_the_middle(framed) -> None:
    view = framed.capture.train[0]
    assert not judge_cameras_of_file([view])
    off = replace(view, camera=replace(view.camera, cx=0.9 * view.camera.width))
    (finding,) = judge_cameras_of_file([view, off])
    assert finding.what.startswith("1 of 2 views has")


@pytest.mark.parametrize(
    ("files", "named"),
    [
        (["tracked_flame_params_30.npz"], "what VHAP's tracker writes"),
        (["a/transforms_train.json", "b/transforms_train.json"], "holds 2 captures"),
        (["transforms.json"], "no splits of it"),
        (["calibration/camera_params.json"], "raw recording of NeRSemble"),
        (["images/00000.jpg"], "without tracking"),
        (["point_cloud/iteration_30000/point_cloud.ply", "images/00000.jpg"], "is a trained model, not a capture"),
    ],
)
def test_what_people_name_instead_of_a_capture(tmp_path: Path, files: list[str], named: str) -> None:
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    assert named in (guess_folder(tmp_path) or "")


def test_nothing_is_guessed_of_a_folder_that_says_nothing(tmp_path: Path) -> None:
    assert guess_folder(tmp_path) is None
    assert guess_folder(tmp_path / "missing") is None


def test_only_triangles_that_face_the_camera_have_edges() -> None:
    """A tetrahedron seen from +z with y down: of its four triangles, the three that lean towards the camera."""
    places = np.array([[0.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])  # a base and its top in the middle
    base, sides = [[0, 2, 1]], [[0, 1, 3], [1, 2, 3], [2, 0, 3]]
    edges = facing_edges(places, np.array(base + sides))
    assert sorted(map(tuple, edges.tolist())) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    assert len(facing_edges(places, np.array(base))) == 0
    assert len(facing_edges(places * np.nan, np.array(base + sides))) == 0


def test_the_mesh_is_drawn_over_the_head_and_the_mask_round_it(framed, tmp_path) -> None:
    view = framed.capture.train[0]
    image, mask = framed.capture.image(view), foreground(framed.capture, view)
    drawn = over_image(image, mask, Poser(framed.head, framed.motion)(view.timestep), framed.head.faces, view.camera)
    touched = (drawn != image).any(axis=2)
    grown = mask.copy()
    for axis in (0, 1):
        for step in (-3, -2, -1, 1, 2, 3):
            grown |= np.roll(mask, step, axis)
    assert touched[mask].mean() > 0.5
    assert not touched[~grown].any()
    assert (drawn == MASK_COLOUR).all(axis=2).sum() > 50
    write_overlay(tmp_path / "sheet.png", framed.capture, framed.head, [[view]], {view.image_path: mask})
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width >= view.camera.width
