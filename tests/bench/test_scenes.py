"""Scenes made by code: what they promise of themselves."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.bench.scenes import RADII, cameras_around, front_camera, head_shell, made_avatar, made_head
from sacha_core.bench.trial import made_trial
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.scene import render_avatar

UNIT = 1e-6  # float32 rounding


def test_the_shell_has_the_size_of_a_head_and_is_the_same_each_time() -> None:
    one, other = head_shell(1000, channels=2, seed=3), head_shell(1000, channels=2, seed=3)
    assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True))
    assert np.abs(np.linalg.norm(one.means / RADII, axis=1) - 1).max() < UNIT
    assert np.abs(np.linalg.norm(one.quaternions, axis=1) - 1).max() < UNIT
    assert one.colours.shape == (1000, 2)


@pytest.mark.parametrize("degree", [0, 3])
def test_a_made_avatar_is_a_valid_one_sorted_by_triangle(degree: int) -> None:
    avatar, head = made_avatar(700, degree, n_frames=5, seed=1)
    avatar.gaussians.validate(head.n_faces)
    assert len(avatar.gaussians) == 700
    assert avatar.gaussians.sh_degree == degree
    assert (np.diff(avatar.gaussians.binding) >= 0).all()
    assert avatar.head == head.reference
    assert len(avatar.motion) == 5
    again, _ = made_avatar(700, degree, n_frames=5, seed=1)
    assert np.array_equal(again.gaussians.position, avatar.gaussians.position)


def test_a_made_avatar_covers_the_head() -> None:
    """As many Gaussians as a trained avatar has leave no holes: the picture's middle is opaque wherever a mesh would be."""
    avatar, head = made_avatar(20_000, 0, n_frames=1)
    frames = triangle_frames(Poser(head, avatar.motion)(0), head.faces)
    alpha = render_avatar(avatar.gaussians, frames, front_camera(48, 70)).alpha
    assert (alpha[30:40, 20:28] > 0.9).all()
    assert alpha[0].max() < 0.1


@pytest.mark.parametrize("count", [1, 4])
def test_cameras_around_a_head_see_all_of_it(count: int) -> None:
    vertices = made_head().v_template
    cameras = cameras_around(vertices, count, 90, 120)
    assert len(cameras) == count
    for camera in cameras:
        x, y, z = (vertices @ camera.rotation.T + camera.translation).T
        assert z.min() > 0.5
        for at, focal, centre, side in ((x, camera.fx, camera.cx, 90), (y, camera.fy, camera.cy, 120)):
            assert (at / z * focal + centre).min() >= 0
            assert (at / z * focal + centre).max() <= side
    assert cameras[0].centre[2] > vertices[:, 2].max()  # the first stands before the face


def test_a_trial_has_something_to_learn() -> None:
    trial = made_trial(300, (32, 48), 2)
    assert len(trial.targets) == 4
    for target in trial.targets:
        left, top, right, bottom = target.box
        outside = np.ones(target.sensitivity.shape, bool)
        outside[top:bottom, left:right] = False
        assert (target.image[:, outside] == 255).all()
        assert (target.image[:, top:bottom, left:right] != 255).any()
