"""Oracle: FLAME's equations one vertex and one joint at a time in float64, with SciPy's Rotation; then laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided
from scipy.spatial.transform import Rotation

from sacha_core.avatar.motion import Motion
from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, pose_many, pose_vertices

FLAME_ANGLE = 2e-7  # FLAME's angle offset of 1e-8, times lengths of a few metres and a chain of three joints
ROUNDING_64 = 1e-12
ROUNDING_32 = 2e-5  # float32 on coordinates of a few metres through a chain of three joints; 0.02 mm on a head


def naive_pose(head: HeadModel, motion: Motion, frame: int) -> np.ndarray:
    """Follow the equations literally."""
    n_joints = len(head.parents)
    shaped = head.v_template.astype(np.float64)
    for k, beta in enumerate(motion.shape):
        shaped = shaped + float(beta) * head.shapedirs[:, :, k]
    for k, psi in enumerate(motion.expression[frame]):
        shaped = shaped + float(psi) * head.exprdirs[:, :, k]
    if len(motion.static_offset):
        shaped = shaped + motion.static_offset
    joints = head.J_regressor.astype(np.float64) @ shaped
    pose = [
        motion.rotation[frame],
        motion.neck[frame],
        motion.jaw[frame],
        motion.eyes[frame][:3],
        motion.eyes[frame][3:],
    ]
    rotations = [Rotation.from_rotvec(theta.astype(np.float64)).as_matrix() for theta in pose[:n_joints]]
    feature = np.concatenate([(r - np.eye(3)).ravel() for r in rotations[1:]]) if n_joints > 1 else np.zeros(0)
    world: list[np.ndarray] = []
    for j, parent in enumerate(head.parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] - (joints[parent] if parent >= 0 else 0)
        world.append(world[parent] @ local if parent >= 0 else local)
    posed = np.zeros_like(shaped)
    for v in range(head.n_vertices):
        point = shaped[v] if head.posedirs is None else shaped[v] + head.posedirs[v].astype(np.float64) @ feature
        for j in range(n_joints):
            posed[v] += float(head.weights[v, j]) * (world[j] @ [*(point - joints[j]), 1])[:3]
    return posed + motion.translation[frame]


@pytest.mark.parametrize("n_joints", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("correctives", [True, False])
def test_against_the_equations(make_head, make_motion, n_joints: int, correctives: bool) -> None:
    head = make_head(n_joints, correctives=correctives)
    motion = make_motion(head)
    poser = Poser(head, motion, np.float64)
    for frame in range(len(motion)):
        np.testing.assert_allclose(poser(frame), naive_pose(head, motion, frame), atol=FLAME_ANGLE)


def test_float32_is_precise_enough(random_head: HeadModel, random_motion: Motion) -> None:
    single, double = Poser(random_head, random_motion), Poser(random_head, random_motion, np.float64)
    assert single(2).dtype == np.float32
    np.testing.assert_allclose(single(2), double(2), atol=ROUNDING_32)


def test_rest_is_the_template(random_head: HeadModel) -> None:
    rest = Motion.rest(6, 7)
    np.testing.assert_allclose(Poser(random_head, rest, np.float64)(0), random_head.v_template, atol=10 * FLAME_ANGLE)


def test_translation_moves_every_vertex_alike(random_head: HeadModel, random_motion: Motion) -> None:
    moved = replace(random_motion, translation=random_motion.translation + np.float32([1, -2, 3]))
    before, after = (Poser(random_head, motion, np.float64)(1) for motion in (random_motion, moved))
    np.testing.assert_allclose(after - before, np.broadcast_to([1, -2, 3], before.shape), atol=1e-6)


def test_the_root_turns_the_posed_head_about_its_joint(random_head: HeadModel, random_motion: Motion) -> None:
    still = replace(random_motion, rotation=np.zeros_like(random_motion.rotation))
    before, after = (Poser(random_head, motion, np.float64)(1) for motion in (still, random_motion))
    turn = Rotation.from_rotvec(random_motion.rotation[1].astype(np.float64)).as_matrix()
    shift = (after - before @ turn.T) - (after - before @ turn.T)[0]
    np.testing.assert_allclose(shift, 0, atol=10 * FLAME_ANGLE)


def test_many_frames_have_the_bits_of_one_and_one(random_head: HeadModel, random_motion: Motion) -> None:
    together = pose_many(random_head, random_motion)
    for frame in range(len(random_motion)):
        np.testing.assert_array_equal(together[frame], pose_vertices(random_head, random_motion, frame))


def test_fewer_components_than_the_head_has_are_the_first_ones(random_head: HeadModel, random_motion: Motion) -> None:
    padded = replace(random_motion, shape=np.r_[random_motion.shape[:2], np.zeros(4, np.float32)])
    padded = replace(padded, expression=padded.expression * (np.arange(7) < 3))
    short = replace(padded, shape=padded.shape[:2], expression=padded.expression[:, :3])
    long = replace(
        padded, expression=np.pad(padded.expression, ((0, 0), (0, 93))), shape=np.pad(padded.shape, (0, 294))
    )
    for other in (short, long):
        np.testing.assert_allclose(
            Poser(random_head, other, np.float64)(0), Poser(random_head, padded, np.float64)(0), atol=ROUNDING_64
        )


def test_no_coefficients_are_as_good_as_zeros(random_head: HeadModel, random_motion: Motion) -> None:
    """What lies in memory behind arrays without elements is no number."""
    no_number = np.full(16, np.nan, np.float32)
    nothing = as_strided(no_number, (0,), (0,)), as_strided(no_number, (len(random_motion), 0), (0, 0))
    zeros = np.zeros(2, np.float32), np.zeros((len(random_motion), 2), np.float32)
    for head in (random_head, replace(random_head, posedirs=None)):
        posed, wanted = (
            pose_many(head, replace(random_motion, shape=shape, expression=expression))
            for shape, expression in (nothing, zeros)
        )
        np.testing.assert_array_equal(posed, wanted)


@pytest.mark.parametrize(("name", "shape", "row"), [("shape", (9,), 0), ("expression", (4, 9), 2)])
def test_components_beyond_the_head_are_refused_unless_zero(random_head, random_motion, name, shape, row) -> None:
    values = np.zeros(shape, np.float32)
    values.reshape(-1, 9)[row, 8] = 0.25
    with pytest.raises(HeadError, match=rf"has . {name} components, but component 8 is 0.25 at row {row}"):
        Poser(random_head, replace(random_motion, **{name: values}))


def test_offsets_of_another_topology_are_refused(random_head: HeadModel, random_motion: Motion) -> None:
    with pytest.raises(HeadError, match="static_offset has 29 rows, but head 'random' has 30 vertices"):
        pose_vertices(random_head, replace(random_motion, static_offset=np.zeros((29, 3), np.float32)), 0)


def test_no_such_frame(random_head: HeadModel, random_motion: Motion) -> None:
    with pytest.raises(IndexError):
        pose_vertices(random_head, random_motion, len(random_motion))
