"""What is sent to a browser. Oracle: the plain twins of posing and carrying, and the codec."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians, sigmoid, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.codec import decode, encode
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.quaternion import to_matrix
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.harmonics import sh_colours
from sacha_core.viewer.grades import AS_OPENED, Grades
from sacha_core.viewer.puppet import Gesture, Puppet

FLOAT32_M = 2e-6  # of a posed coordinate of some decimetres through some joints
EYE = np.float32([0.1, 0.0, 1.0])


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture(scope="module")
def gaussians(head: HeadModel) -> Gaussians:
    rng = np.random.default_rng(2)
    start = initial_gaussians(head.n_faces, rng, sh_degree=1)
    return replace(
        start,
        quaternion=rng.normal(size=start.quaternion.shape).astype(np.float32),
        sh_dc=rng.normal(size=start.sh_dc.shape).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, start.sh_rest.shape).astype(np.float32),
    )


@pytest.fixture(scope="module")
def motion(head: HeadModel) -> Motion:
    rng = np.random.default_rng(4)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], 3)
    names = ("expression", "rotation", "neck", "jaw", "eyes", "translation")
    return replace(rest, **{name: rng.normal(0, 0.1, getattr(rest, name).shape).astype(np.float32) for name in names})


def world(gaussians: Gaussians, head: HeadModel, motion: Motion, frame: int):
    return to_world(gaussians, triangle_frames(Poser(head, motion)(frame), head.faces))


def test_a_frame_against_the_plain_twins(head: HeadModel, gaussians: Gaussians, motion: Motion) -> None:
    splats = Puppet(head, motion).splats(gaussians, 2, Gesture(), EYE)
    expected = world(gaussians, head, motion, 2)
    axes = to_matrix(expected.quaternions.astype(np.float64)) * expected.scales[:, None, :]
    assert np.abs(splats.means - expected.means).max() < FLOAT32_M
    assert np.abs(splats.covariances - axes @ axes.transpose(0, 2, 1)).max() < FLOAT32_M * np.abs(axes).max()
    assert np.array_equal(splats.opacities[:, 0], sigmoid(gaussians.opacity_logit))
    colours = sh_colours(gaussians.sh_dc, gaussians.sh_rest, splats.means, EYE, 1)
    assert np.array_equal(splats.colours, np.clip(colours, 0, 1))


def test_a_gesture_adds_to_the_frame(head: HeadModel, gaussians: Gaussians, motion: Motion) -> None:
    last = head.exprdirs.shape[2] - 1
    narrow = replace(motion, expression=motion.expression[:, :1])  # a hand moves components that the motion lacks
    gesture = Gesture({last: 1.5}, {"jaw": (0.2, 0.0, 0.0), "right_eye": (0.0, 0.3, 0.0)})
    splats = Puppet(head, narrow).splats(gaussians, 1, gesture, EYE)
    expression = np.pad(narrow.expression, ((0, 0), (0, last)))
    expression[1, last] += 1.5
    jaw, eyes = motion.jaw.copy(), motion.eyes.copy()
    jaw[1, 0] += 0.2
    eyes[1, 4] += 0.3
    expected = world(gaussians, head, replace(motion, expression=expression, jaw=jaw, eyes=eyes), 1)
    assert np.abs(splats.means - expected.means).max() < FLOAT32_M
    assert np.abs(splats.means - world(gaussians, head, motion, 1).means).max() > 1e-3


def test_without_a_motion_the_head_is_at_rest(head: HeadModel, gaussians: Gaussians) -> None:
    puppet = Puppet(head, None)
    assert len(puppet) == 1
    expected = to_world(gaussians, triangle_frames(head.v_template, head.faces))
    assert np.abs(puppet.splats(gaussians, 0, Gesture(), EYE).means - expected.means).max() < FLOAT32_M


def test_given_colours_are_shown_instead(head: HeadModel, gaussians: Gaussians) -> None:
    colours = np.full((len(gaussians), 3), 0.25, np.float32)
    shown = Puppet(head, None).splats(gaussians, 0, Gesture(), EYE, colours)
    assert np.array_equal(shown.colours, colours)


def test_levels_are_what_the_codec_gives_back(head: HeadModel, gaussians: Gaussians) -> None:
    grades = Grades(Avatar(gaussians, head.reference), head)
    assert grades[AS_OPENED] == (gaussians, None)
    found, n_bytes = grades["level 2"]
    data = encode(Avatar(gaussians, head.reference), 2, head=head)
    assert n_bytes == len(data)
    assert np.array_equal(found.position, decode(data, head=head).gaussians.position)
    assert grades["level 2"][0] is found
