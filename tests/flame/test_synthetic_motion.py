"""The synthetic head moving: lids close on the eyeball, the jaw takes what is its own, and no parameter folds a triangle flat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import pose_vertices
from sacha_core.flame.synthetic import EXPRESSIONS, IDENTITY, head_parts, synthetic_head

# Vertices are float32: about 7e-9 m at a head's size. Over edges of a millimetre that is 1e-11 m2 of area; a hundred times that is sound.
MIN_AREA_M2 = 1e-9
GAP_LEFT = 0.10  # share of the lids' gap that a blink may leave
PENETRATION_M = 0.0003
FLOAT32_M = 1e-7  # positions of a tenth of a metre after a few float32 operations


def rest(head: HeadModel) -> Motion:
    return Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])


def posed(head: HeadModel, expression: dict[str, float] | None = None, **rotations: tuple[float, ...]) -> np.ndarray:
    motion = rest(head)
    weights = np.zeros((1, len(EXPRESSIONS)), np.float32)
    for name, weight in (expression or {}).items():
        weights[0, EXPRESSIONS.index(name)] = weight
    turned = {name: np.array([angles], np.float32) for name, angles in rotations.items()}
    return pose_vertices(head, replace(motion, expression=weights, **turned), 0)


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(vertices[faces].astype(np.float64), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def lid_gap(vertices: np.ndarray, head: HeadModel, size: str, side: str) -> float:
    """Greatest height between the margins of the lids at one place between the corners."""
    margin = vertices[head_parts(size)[f"{side}_eye/margin"]]
    x = head.v_template[head_parts(size)[f"{side}_eye/margin"], 0]
    # On the template each point of the upper margin has its partner on the lower at the same x.
    return max(float(np.ptp(margin[np.abs(x - at) < 1e-5, 1])) for at in x)


def eye_centre(head: HeadModel, side: str) -> np.ndarray:
    return head.J_regressor[3 if side == "left" else 4].astype(np.float64) @ head.v_template


def test_zero_pose_is_the_template(head: HeadModel) -> None:
    np.testing.assert_allclose(posed(head), head.v_template, rtol=0, atol=FLOAT32_M)


@pytest.mark.parametrize("side", ["left", "right"])
def test_blink_closes_the_eye(head: HeadModel, size: str, side: str) -> None:
    opened = lid_gap(head.v_template, head, size, side)
    closed = posed(head, {f"blink_{side}": 1.0})
    assert opened > 0.007
    assert lid_gap(closed, head, size, side) < GAP_LEFT * opened
    other = "right" if side == "left" else "left"
    assert lid_gap(closed, head, size, other) == pytest.approx(opened, rel=1e-4)


@pytest.mark.parametrize("name", ["blink", "squint", "wide"])
@pytest.mark.parametrize("weight", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_lids_stay_off_the_eyeball(head: HeadModel, size: str, name: str, weight: float) -> None:
    parts = head_parts(size)
    vertices = posed(head, {f"{name}_left": weight}).astype(np.float64)
    lids = np.concatenate([parts[f"left_eye/{ring}"] for ring in ("crease", "lid", "margin")])
    radius = np.linalg.norm(vertices[parts["left_eyeball"][0]] - eye_centre(head, "left"))
    outside = head.faces[np.isin(head.faces, lids).all(axis=1)]
    # The visible sheet of the lids: corners, and where triangles are small enough to lie on a ball, middles of edges and centroids too.
    samples = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 1, 1]], float)
    samples = (samples / samples.sum(axis=1, keepdims=True))[: None if size == "full" else 3]
    sheet = np.einsum("sk,fkc->fsc", samples, vertices[outside]).reshape(-1, 3)
    assert np.linalg.norm(sheet - eye_centre(head, "left"), axis=1).min() > radius - PENETRATION_M


def test_jaw_opens_the_mouth(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    opened = posed(head, jaw=(0.3, 0.0, 0.0))
    slit = parts["mouth/slit"]

    def gap(vertices: np.ndarray) -> float:
        middle = np.abs(head.v_template[slit, 0]) < 0.004
        return float(np.ptp(vertices[slit[middle], 1]))

    assert gap(head.v_template) < 0.004
    assert gap(opened) > 0.020
    np.testing.assert_allclose(
        opened[parts["upper_teeth"]], head.v_template[parts["upper_teeth"]], rtol=0, atol=FLOAT32_M
    )
    before, after = head.v_template[parts["lower_teeth"]], opened[parts["lower_teeth"]]
    assert (before[:, 1] - after[:, 1]).min() > 0.01
    # Theorem: a rigid motion keeps distances.
    np.testing.assert_allclose(distances(after), distances(before), rtol=0, atol=2 * FLOAT32_M)
    above = head.v_template[:, 1] > 0.05
    np.testing.assert_allclose(opened[above], head.v_template[above], rtol=0, atol=FLOAT32_M)


def distances(points: np.ndarray) -> np.ndarray:
    points = points.astype(np.float64)
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def test_eyes_turn_alone_and_lids_follow_the_pitch(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    patch = np.concatenate([ids for name, ids in parts.items() if name.startswith("left_eye/")])
    moved = np.abs(posed(head, eyes=(0.0, 0.4, 0.0, 0.0, 0.0, 0.0)) - head.v_template).max(axis=1) > 2 * FLOAT32_M
    assert set(np.flatnonzero(moved)) <= set(parts["left_eyeball"].tolist())
    assert moved.sum() >= len(parts["left_eyeball"]) - 2  # all but the poles of its turning, if vertices lie there
    down = posed(head, eyes=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0))
    moved = np.abs(down - head.v_template).max(axis=1) > 2 * FLOAT32_M
    assert set(np.flatnonzero(moved)) <= set(parts["left_eyeball"].tolist()) | set(patch.tolist())
    margin = parts["left_eye/margin"]
    top = margin[np.argmax(head.v_template[margin, 1])]
    assert down[top, 1] < head.v_template[top, 1] - 0.001
    front = parts["left_eyeball"][0]
    assert down[front, 1] < head.v_template[front, 1] - 0.003


def test_expressions_leave_eyeballs_and_teeth(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    hard = np.concatenate([parts[name] for name in ("left_eyeball", "right_eyeball", "upper_teeth", "lower_teeth")])
    assert not head.exprdirs[hard].any()


def test_identity_keeps_eyeballs_round_and_lids_on_them(head: HeadModel, size: str) -> None:
    parts = head_parts(size)
    for side in ("left", "right"):
        ball = head.shapedirs[parts[f"{side}_eyeball"]]
        np.testing.assert_array_equal(ball, np.broadcast_to(ball[:1], ball.shape))  # a translation
        margin = head.shapedirs[parts[f"{side}_eye/margin"]]
        np.testing.assert_array_equal(margin, np.broadcast_to(ball[:1], margin.shape))


def test_left_and_right_expressions_mirror_each_other(head: HeadModel, mirrored: np.ndarray) -> None:
    for name in EXPRESSIONS:
        if not name.endswith("_left") or name.replace("left", "right") not in EXPRESSIONS:
            continue
        left = head.exprdirs[:, :, EXPRESSIONS.index(name)]
        right = head.exprdirs[:, :, EXPRESSIONS.index(name.replace("left", "right"))]
        np.testing.assert_allclose(left[mirrored] * [-1, 1, 1], right, rtol=0, atol=2.0**-20)


def test_components_are_of_natural_size_and_none_repeats_another(head: HeadModel, size: str) -> None:
    for directions, names in ((head.shapedirs, IDENTITY), (head.exprdirs, EXPRESSIONS)):
        reach = np.linalg.norm(directions, axis=1).max(axis=0)
        assert len(set(names)) == len(names)
        if size == "full":  # a coarse head may miss the middle of a movement
            assert (reach > 0.001).all(), dict(zip(names, reach, strict=True))
        assert (reach < 0.016).all(), dict(zip(names, reach, strict=True))
    everything = np.concatenate([head.shapedirs, head.exprdirs], axis=2).reshape(-1, len(IDENTITY) + len(EXPRESSIONS))
    assert np.linalg.matrix_rank(everything.astype(np.float64), tol=1e-5) == everything.shape[1]


def random_motion(head: HeadModel, seed: int) -> Motion:
    rng = np.random.default_rng(seed)
    return replace(
        rest(head),
        shape=rng.uniform(-2, 2, len(IDENTITY)).astype(np.float32),
        expression=rng.uniform(-1, 1, (1, len(EXPRESSIONS))).astype(np.float32),
        jaw=np.array([[rng.uniform(0, 0.4), 0.0, 0.0]], np.float32),
        neck=rng.uniform(-0.4, 0.4, (1, 3)).astype(np.float32),
        eyes=rng.uniform(-0.3, 0.3, (1, 6)).astype(np.float32),
    )


@given(seed=st.integers(0, 2**32 - 1))
def test_no_triangle_degenerates(seed: int) -> None:
    for head in HEADS:
        vertices = pose_vertices(head, random_motion(head, seed), 0)
        assert np.isfinite(vertices).all()
        assert areas(vertices, head.faces).min() > MIN_AREA_M2


HEADS = [synthetic_head(size) for size in ("full", "small")]


def test_no_single_full_movement_degenerates_a_triangle(head: HeadModel) -> None:
    for name in EXPRESSIONS:
        assert areas(posed(head, {name: 1.0}), head.faces).min() > MIN_AREA_M2, name
    assert areas(head.v_template, head.faces).min() > 50 * MIN_AREA_M2
