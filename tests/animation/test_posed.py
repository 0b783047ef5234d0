"""Oracles: `Poser`, `triangle_frames` and `to_world` in NumPy and float64; a singled-out direction; the same bits for every pool."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from posed_heads import random_gaussians, random_head, random_motion

from sacha_core.animation.carry import carry, room_for
from sacha_core.animation.posed import Pose, PosedHead
from sacha_core.avatar.binding import to_world
from sacha_core.avatar.motion import Motion
from sacha_core.bench.scenes import made_head, made_motion
from sacha_core.errors import GeometryError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry import quaternion
from sacha_core.geometry.rotation import rotation_vectors_to_matrices
from sacha_core.geometry.skinning import joint_transforms
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.parallel.pool import Pool
from sacha_core.train.rig import Rig
from sacha_core.train.state import FITTED_MOTION

ROUNDING_64 = 1e-12  # of numbers of a few metres and of unit vectors
# float32 on coordinates of a few metres, through three joints, sums of 60 directions, and triangles with angles down to a degree
ROUNDING_32 = {"vertices": 1e-5, "frames": 2e-4, "carried": 1e-3}
DTYPES = (np.float32, np.float64)


def arguments(motion: Motion, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    vectors = [getattr(motion, name)[frame] for name in ("rotation", "neck", "jaw", "eyes")]
    return motion.expression[frame], np.concatenate(vectors).reshape(5, 3), motion.translation[frame]


def arrays_of(pose: Pose) -> dict[str, np.ndarray]:
    own = {f.name: getattr(pose, f.name) for f in fields(pose) if f.name != "frames"}
    return own | {f"frames.{f.name}": getattr(pose.frames, f.name) for f in fields(pose.frames)}


@pytest.fixture(scope="module", params=[(5, True), (5, False), (3, True), (1, False)], ids=str)
def head(request: pytest.FixtureRequest) -> HeadModel:
    return random_head(*request.param)


@pytest.mark.parametrize("dtype", DTYPES)
def test_posing_agrees_with_numpy(head: HeadModel, dtype: type) -> None:
    motion = random_motion()
    posed, poser = PosedHead(head, motion, Pool(2), dtype), Poser(head, motion, np.float64)
    exact = dtype is np.float64
    for frame in (2, 0):
        pose = posed.pose(*arguments(motion, frame))
        assert {a.dtype for a in arrays_of(pose).values()} == {np.dtype(dtype)}
        vertices = poser(frame)
        frames = triangle_frames(vertices, head.faces)
        np.testing.assert_allclose(
            pose.vertices, vertices, rtol=0, atol=ROUNDING_64 if exact else ROUNDING_32["vertices"]
        )
        tolerance = {"rtol": 0, "atol": 10 * ROUNDING_64 if exact else ROUNDING_32["frames"]}
        for name in ("rotation", "scale", "origin"):
            np.testing.assert_allclose(getattr(pose.frames, name), getattr(frames, name), **tolerance)
        np.testing.assert_allclose(quaternion.to_matrix(pose.quaternions), frames.rotation, **tolerance)
        np.testing.assert_allclose(
            pose.quaternions[np.arange(len(head.faces)), np.abs(pose.quaternions).argmax(1)] > 0, 1
        )


def test_what_a_way_back_needs_agrees_with_numpy(head: HeadModel) -> None:
    motion = random_motion()
    poser = Poser(head, motion, np.float64)
    expression, vectors, translation = arguments(motion, 1)
    pose = PosedHead(head, motion, dtype=np.float64).pose(expression, vectors, translation)
    rotations = rotation_vectors_to_matrices(vectors.astype(np.float64)[: len(head.parents)])
    unposed, joints = poser.unposed(expression.astype(np.float64), rotations)
    expected = {
        "vectors": vectors[: len(head.parents)], "rotations": rotations, "unposed": unposed, "joints": joints,
        "transforms": joint_transforms(rotations, joints, head.parents),
    }  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(pose, name), value, rtol=0, atol=ROUNDING_64, err_msg=name)


@pytest.mark.parametrize("dtype", DTYPES)
def test_carrying_agrees_with_numpy(dtype: type) -> None:
    head, motion = random_head(), random_motion()
    gaussians = random_gaussians(head.n_faces)
    gaussians.quaternion[3] = 0
    pose = PosedHead(head, motion, dtype=dtype).pose(*arguments(motion, 0))
    doubles = {name: getattr(gaussians, name).astype(dtype) for name in ("position", "log_scale", "quaternion")}
    out = room_for(len(gaussians), dtype)
    carried = carry(**doubles, binding=gaussians.binding, pose=pose, pool=Pool(2), out=out)
    assert all(a is b for a, b in zip(carried, out, strict=True))
    world = to_world(gaussians, triangle_frames(Poser(head, motion, np.float64)(0), head.faces))
    # the reference writes float32 and turns by quaternions that it rounds; its own error is below that
    atol = 1e-6 if dtype is np.float64 else ROUNDING_32["carried"]
    for ours, name in zip(carried, ("means", "scales", "quaternions"), strict=True):
        expected = getattr(world, name)
        np.testing.assert_allclose(ours, expected, rtol=atol, atol=atol, err_msg=name)
    np.testing.assert_array_equal(carried[2][3], 0)


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_number_of_threads_changes_no_bit(dtype: type) -> None:
    head, motion = random_head(), random_motion()
    gaussians = random_gaussians(head.n_faces, 1003)
    local = [getattr(gaussians, name).astype(dtype) for name in ("position", "log_scale", "quaternion")]

    def outcome(pool: Pool | None) -> list[bytes]:
        pose = PosedHead(head, motion, pool, dtype).pose(*arguments(motion, 1))
        carried = carry(*local, gaussians.binding, pose, pool)
        return [a.tobytes() for a in (*arrays_of(pose).values(), *carried)]

    alone = outcome(None)
    for threads in (1, 2, 3, 7):
        assert outcome(Pool(threads)) == alone


def test_zero_coefficients_are_not_read() -> None:
    """A direction that is not a number would spoil every vertex if it took part."""
    head, motion = random_head(), random_motion()
    expression, vectors, translation = arguments(motion, 0)
    expression, vectors = expression.copy(), np.zeros_like(vectors)
    expression[[2, 5]] = 0
    expected = PosedHead(head, motion).pose(expression, vectors, translation).vertices.copy()
    posed = PosedHead(head, motion)
    posed.poser.directions[[2, 5, *range(len(expression), len(posed.poser.directions))]] = np.nan
    np.testing.assert_array_equal(posed.pose(expression, vectors, translation).vertices, expected)


def test_coefficients_beyond_the_directions_are_ignored() -> None:
    head, motion = random_head(), random_motion(n_expression=4)
    posed, poser = PosedHead(head, motion, dtype=np.float64), Poser(head, motion, np.float64)
    expression, vectors, translation = arguments(motion, 0)
    longer = np.concatenate([expression, [3, 4]])
    np.testing.assert_allclose(posed.pose(longer, vectors, translation).vertices, poser(0), rtol=0, atol=ROUNDING_64)


def test_missing_coefficients_are_zero(head: HeadModel) -> None:
    motion = random_motion()
    posed = PosedHead(head, motion)
    expression, vectors, translation = arguments(motion, 0)
    padded = np.where(np.arange(len(expression)) < 4, expression, 0)
    expected = posed.pose(padded, vectors, translation).vertices.copy()
    np.testing.assert_array_equal(posed.pose(expression[:4], vectors, translation).vertices, expected)


@pytest.mark.parametrize("threads", [1, 2])
def test_degenerate_triangles_are_refused_as_numpy_does(threads: int) -> None:
    head, motion = random_head(), random_motion()
    for face in (650, 130):  # the first of them is to be named
        head.faces[face, 2] = head.faces[face, 1]
    with pytest.raises(GeometryError) as expected:
        triangle_frames(
            PosedHead(replace(head, faces=head.faces[:1]), motion).pose(*arguments(motion, 0)).vertices, head.faces
        )
    with pytest.raises(GeometryError) as error:
        PosedHead(head, motion, Pool(threads)).pose(*arguments(motion, 0))
    assert str(error.value) == str(expected.value)
    assert str(error.value).startswith("triangle 130 has zero area: vertices ")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("squared", ["edge", "area"])
def test_triangles_are_refused_where_numpy_refuses_them(dtype: type, squared: str) -> None:
    """Triangles from far too small to large enough: those whose squares underflow are refused, and the first of the others is not."""
    smallest = float(np.finfo(dtype).tiny)
    base = smallest ** (1 / 2 if squared == "edge" else 1 / 4)  # of a right angle's first leg
    other = 1.0 if squared == "edge" else base
    for factor in (0.5, 0.9, 1.1, 2.0):
        corners = np.array([[0, 0, 0], [factor * base, 0, 0], [0, other, 0]])
        rest = np.zeros((1, 3))
        head = replace(random_head(1, correctives=False, v=4, f=1), faces=np.array([[0, 1, 2]], np.int32))
        posed = PosedHead(head, random_motion(), dtype=dtype)
        posed.poser.template[:] = np.concatenate([corners, rest])
        still = np.zeros(0), np.zeros((5, 3)), np.zeros(3)
        if factor < 1:
            with pytest.raises(GeometryError) as expected:
                triangle_frames(posed.poser.template, head.faces)
            with pytest.raises(GeometryError) as error:
                posed.pose(*still)
            assert str(error.value) == str(expected.value)
        else:
            pose = posed.pose(*still)
            np.testing.assert_allclose(
                pose.frames.scale, triangle_frames(posed.poser.template, head.faces).scale, rtol=1e-5
            )


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_vertices_that_are_not_finite_are_refused(value: float) -> None:
    head, motion = random_head(), random_motion()
    expression, vectors, translation = arguments(motion, 0)
    with pytest.raises(GeometryError, match="triangle 0 has"):
        PosedHead(head, motion).pose(expression, vectors, translation + np.float32(value))


def test_head_that_lacks_what_the_motion_uses() -> None:
    with pytest.raises(HeadError, match="expression components"):
        PosedHead(random_head(), random_motion(n_expression=30))


def test_directions_are_not_read_where_they_move_nothing() -> None:
    """Exact: local directions give the bits that they give when every block of vertices looks at all of them, both ways."""
    head, motion = made_head(), made_motion(1)
    sparse, dense = Rig(head, motion, Pool(2)), Rig(head, motion, Pool(1))
    assert sparse._posed.moves.mean() < 0.5
    dense._posed.moves[:] = True
    parameters = {name: getattr(motion, name)[0] for name in FITTED_MOTION}
    found, expected = sparse.pose(parameters), dense.pose(parameters)
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    pulls = np.random.default_rng(0).normal(size=sparse.g_corners.shape)
    sparse.g_corners[:], dense.g_corners[:] = pulls, pulls
    slopes, expected_slopes = sparse.backward(found, parameters), dense.backward(expected, parameters)
    for name in FITTED_MOTION:
        assert np.abs(slopes[name]).max() > 0
        np.testing.assert_array_equal(slopes[name], expected_slopes[name])
