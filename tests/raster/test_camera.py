"""The camera's own arithmetic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.raster.camera import Camera


def project(camera: Camera, point: np.ndarray) -> np.ndarray:
    x, y, z = camera.rotation @ point + camera.translation
    return np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])


def test_looks_at_the_target_from_the_eye_with_y_up() -> None:
    eye, target = np.array([0.4, 0.3, 1.1]), np.array([0.0, 0.1, 0.0])
    camera = Camera.look_at(eye, target, 60, 80, 70.0)
    assert np.allclose(camera.centre, eye)
    assert np.allclose(camera.rotation @ camera.rotation.T, np.eye(3))
    assert np.linalg.det(camera.rotation) == pytest.approx(1)
    assert np.allclose(project(camera, target), (30, 40))
    assert project(camera, target + np.array([0, 0.1, 0]))[1] < 40  # up in the world is up in the image
    assert project(camera, target + np.array([0.1, 0, 0]))[0] > 30


def test_crops_shift_and_resizing_scales() -> None:
    camera = Camera.look_at(np.array([0, 0, 1.0]), np.zeros(3), 60, 80, 70.0)
    point = np.array([0.1, 0.2, 0.05])
    part = camera.crop(11, 7, 20, 30)
    assert np.allclose(project(part, point), project(camera, point) - np.array([11, 7]))
    assert np.allclose(project(camera.resized(120, 40), point), project(camera, point) * np.array([2, 0.5]))
    assert part.edges == camera.edges == part.crop(1, 1, 3, 3).edges
    assert np.allclose(camera.edges, (-30 / 70, 30 / 70, -40 / 70, 40 / 70))


def test_projects_many_points_as_one_by_one_and_none_from_behind() -> None:
    camera = Camera.look_at(np.array([0.4, 0.3, 1.1]), np.array([0.0, 0.1, 0.0]), 60, 80, 70.0).resized(120, 40)
    points = np.random.default_rng(3).uniform(-3, 3, (200, 3)).astype(np.float32)
    places = camera.project(points)
    assert places.dtype == np.float64
    front = (points - camera.centre) @ camera.rotation[2] > 0
    assert 0 < front.sum() < len(points)
    assert np.isnan(places[~front]).all()
    assert np.allclose(places[front], [project(camera, point) for point in points[front]])
    assert camera.project(points[:0]).shape == (0, 2)
    beside = replace(camera, rotation=np.eye(3), translation=np.zeros(3))
    assert np.isnan(beside.project(np.array([[1.0, 2.0, 0.0]]))).all()  # neither in front nor behind
