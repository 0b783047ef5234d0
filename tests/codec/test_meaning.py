"""Oracle: what FORMAT.md says of the arrays, in plain NumPy. Who goes by the page alone poses and draws what this project does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference_meaning import colours_of, functions_of, placed, posed_vertices
from synthetic_avatars import random_avatar, random_motion, small_head

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import to_world
from sacha_core.codec import decode, embedded_head, encode
from sacha_core.codec.harmonic_metric import harmonics, sphere_directions
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.raster.harmonics import sh_colours

DOUBLE = 1e-12  # sums of a hundred numbers of size one in another order, binary64
SINGLE = 2e-6  # a few roundings to binary32 of numbers of size one
EYE_M = np.array([0.1, 0.05, 0.6])  # where a camera stands
Received = tuple[Avatar, HeadModel]


@pytest.fixture(scope="module")
def received() -> Received:
    """What comes out of a file: Gaussians on the synthetic head, every parameter of whose motion is at work, and that head."""
    head = open_head("synthetic:small")
    avatar = random_avatar(200, head=head, seed=3)
    motion = random_motion(3, head.n_vertices, seed=4)
    motion.shape[:] /= 4
    data = encode(replace(avatar, motion=motion), 4, head=head, embed_head=True, drop_invisible=False)
    inside = embedded_head(data)
    assert inside is not None
    assert inside.posedirs is not None
    assert len(inside.parents) == 5
    return decode(data), inside


@pytest.mark.parametrize("frame", [0, 2])
def test_posing(received: Received, frame: int) -> None:
    avatar, head = received
    assert avatar.motion is not None
    ours = Poser(head, avatar.motion, np.float64)(frame)
    np.testing.assert_allclose(posed_vertices(head, avatar.motion, frame), ours, rtol=0, atol=DOUBLE)


def test_posing_a_head_of_one_joint_without_correctives_and_offsets() -> None:
    head = small_head()
    motion = random_motion(1, 0, n_expression=2)
    motion = replace(motion, shape=motion.shape[:2])
    ours = Poser(head, motion, np.float64)(0)
    np.testing.assert_allclose(posed_vertices(head, motion, 0), ours, rtol=0, atol=DOUBLE)


def test_gaussians_follow_triangles(received: Received) -> None:
    avatar, head = received
    assert avatar.motion is not None
    posed = posed_vertices(head, avatar.motion, 1)
    means, deviations, axes, opacities = placed(avatar.gaussians, posed, head.faces)
    world = to_world(avatar.gaussians, triangle_frames(posed, head.faces))
    np.testing.assert_allclose(world.means, means, rtol=0, atol=SINGLE)
    np.testing.assert_allclose(world.scales, deviations, rtol=SINGLE)
    np.testing.assert_allclose(quaternion.to_matrix(world.quaternions), axes, rtol=0, atol=SINGLE)
    np.testing.assert_allclose(world.opacities, opacities, rtol=0, atol=SINGLE)


def test_colours_are_as_the_page_prints_them(received: Received) -> None:
    avatar, head = received
    assert avatar.motion is not None
    means = placed(avatar.gaussians, posed_vertices(head, avatar.motion, 1), head.faces)[0]
    expected = colours_of(avatar.gaussians, means, EYE_M)
    assert 0 < (expected == 0).mean() < 0.5, "the cut at black is on trial too"
    ours = sh_colours(avatar.gaussians.sh_dc, avatar.gaussians.sh_rest, means, EYE_M, 3)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=SINGLE)
    directions = sphere_directions()
    np.testing.assert_allclose(
        np.stack(functions_of(*directions.T), axis=1), harmonics(directions)[:, 1:], rtol=0, atol=DOUBLE
    )


def test_axes_regions_and_teeth_of_a_head_inside(received: Received) -> None:
    _, head = received
    middle = {name: head.v_template[mask].mean(axis=0) for name, mask in head.masks.items()}
    assert middle["left_eyeball"][0] > 0 > middle["right_eyeball"][0]
    assert middle["scalp"][1] > middle["neck"][1]
    assert middle["nose"][2] > middle["left_eyeball"][2]
    teeth = head.faces[head.n_faces - head.n_teeth_faces :]
    assert 0 < head.n_teeth_faces < head.n_faces
    others = head.faces[: head.n_faces - head.n_teeth_faces]
    assert not np.isin(teeth, others).any(), "teeth hang on nothing"
    assert np.isin(head.weights[teeth], (0, 1)).all(), "and go with one joint each"
