"""Is it found what is wrong with a capture's cameras? Oracle: a capture of the very head, whose cameras are then written down wrongly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sacha_core.evaluate.checkup.alternatives import AS_WRITTEN, BAD, Posed, best_reading, judge_cameras, mean_agreement
from sacha_core.evaluate.checkup.examine import examine
from sacha_core.evaluate.checkup.silhouette import agreement, coarse_mask, surface_points
from sacha_core.evaluate.coverage import foreground, pixels_of
from sacha_core.flame.posing import Poser
from sacha_core.raster.camera import Camera

TURNED = np.array([1.0, -1.0, -1.0])


def read_as_opengl(matrix: np.ndarray, camera: Camera) -> Camera:
    """What a reader makes of a matrix that it takes for camera to world in OpenGL's axes."""
    opencv = matrix @ np.diag([1.0, -1.0, -1.0, 1.0])
    rotation = opencv[:3, :3].T
    return replace(camera, rotation=rotation, translation=-rotation @ opencv[:3, 3])


def world_to_camera(camera: Camera) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.rotation, camera.translation
    return matrix


def opencv_pose(camera: Camera) -> Camera:
    return read_as_opengl(np.linalg.inv(world_to_camera(camera)), camera)


def opencv_inverse(camera: Camera) -> Camera:
    return read_as_opengl(world_to_camera(camera), camera)


def opengl_inverse(camera: Camera) -> Camera:
    return read_as_opengl(np.diag([1.0, -1.0, -1.0, 1.0]) @ world_to_camera(camera), camera)


def in_millimetres(camera: Camera) -> Camera:
    return replace(camera, translation=1000 * camera.translation)


def of_larger_images(camera: Camera) -> Camera:
    return replace(camera, fx=2 * camera.fx, fy=2 * camera.fy, cx=2 * camera.cx, cy=2 * camera.cy)


def cropped(camera: Camera) -> Camera:
    return replace(camera, cx=camera.cx + 0.3 * camera.width)


WRONG = {
    "camera to world in OpenCV's axes": opencv_pose,
    "world to camera in OpenCV's axes": opencv_inverse,
    "world to camera in OpenGL's axes": opengl_inverse,
    "in millimetres": in_millimetres,
    "meant for images twice as wide and high": of_larger_images,
    "with the principal point in the middle": cropped,
}


@pytest.fixture(scope="module")
def posed(framed) -> list[Posed]:
    pose = Poser(framed.head, framed.motion)
    return [
        Posed(
            surface_points(pose(view.timestep), framed.head.faces),
            view.camera,
            coarse_mask(foreground(framed.capture, view)),
        )
        for view in (*framed.capture.train, *framed.capture.test)
    ]


def test_right_cameras_are_taken_as_written(posed: list[Posed]) -> None:
    assert best_reading(posed) == (AS_WRITTEN, mean_agreement(posed))
    assert not judge_cameras(posed)


@pytest.mark.parametrize(("named", "spoil"), WRONG.items(), ids=WRONG)
def test_what_spoiled_the_cameras_is_named(posed: list[Posed], named: str, spoil: Callable[[Camera], Camera]) -> None:
    (finding,) = judge_cameras([replace(view, camera=spoil(view.camera)) for view in posed])
    assert (finding.severity, finding.about) == ("error", "cameras")
    assert named in finding.what


def test_two_faults_at_once_are_both_named(posed: list[Posed]) -> None:
    (finding,) = judge_cameras([replace(view, camera=in_millimetres(opencv_pose(view.camera))) for view in posed])
    assert "OpenCV's axes" in finding.what
    assert "in millimetres" in finding.what


def test_a_head_elsewhere_is_the_reason_that_is_named(posed: list[Posed]) -> None:
    away = [replace(view, points=view.points + np.float32([0.0, 0.6, 0.0])) for view in posed]
    (finding,) = judge_cameras(away)
    assert (finding.severity, finding.about) == ("error", "tracking")
    assert "misses the masks" in finding.what


@pytest.mark.parametrize(("share", "errors"), [(0.2, 0), (0.4, 1)])
def test_a_sequence_that_is_tracked_elsewhere_is_named(posed: list[Posed], share: float, errors: int) -> None:
    """The other views hide it in the mean."""
    n_away = int(share * len(posed))  # a quarter is too much
    moved = [replace(view, points=view.points + np.float32([0.6, 0.0, 0.0])) for view in posed[:n_away]]
    assert mean_agreement([*moved, *posed[n_away:]]) > BAD
    found = judge_cameras([*moved, *posed[n_away:]])
    assert [(finding.severity, finding.about) for finding in found] == [("error", "tracking")] * errors
    assert all(f"in {n_away} of {len(posed)} views" in finding.what for finding in found)


def test_agreement_against_counting_cell_by_cell(posed: list[Posed]) -> None:
    view = posed[0]
    row, column, in_image = pixels_of(view.points, view.camera)
    assert in_image.all()
    head = {(r // view.mask.cell, c // view.mask.cell) for r, c in zip(row.tolist(), column.tolist(), strict=True)}
    mask = {(int(r), int(c)) for r, c in np.argwhere(view.mask.covered)}
    assert agreement(view.points, view.camera, view.mask) == len(head & mask) / len(head | mask)


def test_a_head_behind_the_camera_agrees_with_nothing(posed: list[Posed]) -> None:
    camera = posed[0].camera
    assert agreement(posed[0].points + 5 * (camera.centre + np.array([0.0, 0.0, 5.0])), camera, posed[0].mask) == 0


def test_the_whole_examination_of_a_sound_capture(framed) -> None:
    found = examine(framed.capture, framed.head, (*framed.capture.train, *framed.capture.test))
    assert found.sound
    assert not found.findings
    assert found.agreement > 0.5


def test_the_whole_examination_of_spoiled_cameras(framed) -> None:
    views = [replace(view, camera=opencv_pose(view.camera)) for view in framed.capture.train]
    found = examine(framed.capture, framed.head, views)
    assert not found.sound
    assert [finding.about for finding in found.findings] == ["cameras"]
