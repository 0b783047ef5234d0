"""A rig's arrays, put together by the sentences of its docstring, against the engine's posing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sacha_core.avatar.motion import Motion
from sacha_core.cli.common import HeadSource
from sacha_core.cli.scene import open_scene
from sacha_core.errors import HeadError, TopologyError
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, person_template
from sacha_core.flame.shelf import unwrapped_once
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.quaternion import to_matrix
from sacha_core.geometry.rotation import rotation_vectors_to_matrices
from sacha_core.interchange.head_mesh import HeadMesh, read_head_mesh
from sacha_core.scene.animation import Animation, animation_of
from sacha_core.scene.contents import scene_of_mesh
from sacha_core.scene.rig import LARGEST_VALUE, Rig, rig_of
from sacha_core.scene.topology import as_the_heads, misfit

ROUNDING_M = 5e-7  # float32 of arrays at the size of a head; sums are in double precision
BEYOND = 23.0  # a coefficient that no shape key can hold


@pytest.fixture(scope="module")
def head() -> HeadModel:
    rng = np.random.default_rng(1)
    plain = synthetic_head("small")
    regressor = rng.random(plain.J_regressor.shape)
    return replace(
        plain,
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        posedirs=rng.normal(0, 1e-3, plain.posedirs.shape).astype(np.float32),
    )


@pytest.fixture(scope="module")
def motion(head: HeadModel) -> Motion:
    rng = np.random.default_rng(2)
    rest = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], 5)
    varied = {
        name: rng.normal(0, 1, getattr(rest, name).shape).astype(np.float32)
        for name in ("shape", "expression", "rotation", "neck", "jaw", "eyes", "translation")
    }
    varied["expression"][2, 4] = -BEYOND
    offset = rng.normal(0, 1e-3, (head.n_vertices, 3)).astype(np.float32)
    return replace(rest, static_offset=offset, **varied)


def put_together(rig: Rig, template: np.ndarray, animation: Animation, frame: int) -> np.ndarray:
    """Pose a frame as the docstring of `Rig` says, joint by joint."""
    values, rotations = animation.values[frame].astype(float), to_matrix(animation.quaternions[frame].astype(float))
    entries = (rotations[1:] - np.eye(3)).reshape(-1)[rig.corrective_entries]
    vertices = template + np.einsum("k,kvc->vc", values, rig.directions)
    vertices = vertices + np.einsum("p,pvc->vc", entries, rig.correctives)
    joints = rig.joints + np.einsum("k,kjc->jc", values, rig.joint_directions)
    places: list[np.ndarray] = []
    for joint, (rotation, parent) in enumerate(zip(rotations, rig.parents, strict=True)):
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = rotation, joints[joint] - rotation @ joints[joint]
        places.append(turn if parent < 0 else places[parent] @ turn)
    points = np.concatenate([vertices, np.ones_like(vertices[:, :1])], axis=1)
    moved = np.einsum("vj,jab,vb->va", rig.weights, np.stack(places), points)[:, :3]
    return moved + animation.translation[frame]


def test_the_parts_make_what_posing_makes(head: HeadModel, motion: Motion) -> None:
    rig = rig_of(head, motion)
    animation = animation_of(motion, rig)
    poser, template = Poser(head, motion, np.float64), person_template(head, motion)[0]
    for frame in range(len(motion)):
        assert np.abs(put_together(rig, template, animation, frame) - poser(frame)).max() <= ROUNDING_M


def test_identity_components_make_the_person(head: HeadModel, motion: Motion) -> None:
    rig = rig_of(head, replace(motion, shape=motion.shape[:0]), identity=True)
    n_identity = len(motion.shape)
    assert rig.n_identity == n_identity
    assert rig.names[n_identity - 1 : n_identity + 1] == [f"identity_{n_identity - 1:03d}", head.expression_names[0]]
    still = animation_of(motion, rig)
    assert not still.values[:, :n_identity].any()
    still.values[:, :n_identity] = motion.shape
    template = person_template(head, replace(motion, shape=motion.shape[:0]))[0]
    poser = Poser(head, motion, np.float64)
    assert np.abs(put_together(rig, template, still, 1) - poser(1)).max() <= ROUNDING_M


def test_every_value_is_one_that_a_shape_key_can_hold(head: HeadModel, motion: Motion) -> None:
    rig = rig_of(head, motion)
    values = animation_of(motion, rig).values
    assert np.abs(values).max() <= LARGEST_VALUE
    assert (np.flatnonzero(rig.scales != 1) == [4]).all()
    assert rig.scales[4] == pytest.approx(BEYOND / LARGEST_VALUE)
    assert (values >= rig.ranges[:, 0]).all()
    assert (values <= rig.ranges[:, 1]).all()
    assert rig.names[4] == head.expression_names[4]


def test_quaternions_never_jump_to_the_other_side(head: HeadModel) -> None:
    rest = Motion.rest(0, 0, 40)
    turning = np.zeros((40, 3), np.float32)
    turning[:, 1] = np.linspace(-6, 6, 40)  # nearly twice around
    motion = replace(rest, neck=turning)
    quaternions = animation_of(motion, rig_of(head, motion)).quaternions
    assert (np.einsum("tjc,tjc->tj", quaternions[1:], quaternions[:-1]) > 0.98).all()  # 6 / 39 rad: cos(0.15)


def test_numbers_name_the_expressions_of_a_head_that_names_none(head: HeadModel) -> None:
    unnamed = replace(head, expression_names=())
    rig = rig_of(unnamed, Motion.rest(0, 0))
    assert rig.names[:2] == ["expression_000", "expression_001"]
    assert (rig.ranges == (-LARGEST_VALUE, LARGEST_VALUE)).all()


def test_a_motion_beyond_the_head_is_refused(head: HeadModel) -> None:
    motion = Motion.rest(0, head.exprdirs.shape[2] + 1)
    motion.expression[0, -1] = 1
    with pytest.raises(HeadError, match="expression components"):
        rig_of(head, motion)


def test_split_vertices_are_joined_and_shuffled_triangles_are_refused(head: HeadModel) -> None:
    apart = head.v_template[head.faces].reshape(-1, 3)
    split = HeadMesh(apart, np.arange(len(apart), dtype=np.int32).reshape(-1, 3))
    joined = as_the_heads("split", split, head)
    assert np.array_equal(joined.faces, head.faces)
    assert np.array_equal(joined.vertices, head.v_template)
    skin = head.n_faces - head.n_teeth_faces
    bald = as_the_heads("skin", HeadMesh(apart[: 3 * skin], split.faces[:skin]), head)
    assert np.array_equal(bald.vertices, head.v_template[: len(bald.vertices)])
    turned = HeadMesh(apart, np.roll(split.faces, 1, axis=0))
    with pytest.raises(TopologyError, match="in its order"):
        as_the_heads("turned", turned, head)


@pytest.mark.parametrize(
    ("scale", "turn", "said"),
    [
        (1, (0.2, -0.3, 0.1), None),
        (1000, (0, 0, 0), "1e+03 times as large"),
        (0.1, (0, 0, 0), "0.1 times as large"),
        (1, (np.pi / 2, 0, 0), "turned by 90 degrees"),
        (1, (0, np.pi, 0), "turned by 180 degrees"),
    ],
)
def test_other_units_and_axes_are_noticed(
    head: HeadModel, scale: float, turn: tuple[float, float, float], said: str | None
) -> None:
    rotation = rotation_vectors_to_matrices(np.array(turn, np.float64))
    moved = HeadMesh((scale * head.v_template @ rotation.T + 3).astype(np.float32), head.faces)
    reason = misfit(moved, head)
    assert (reason is None) == (said is None)
    assert said is None or said in reason
    scene = scene_of_mesh("mesh", moved, head)
    assert (scene.rig is None) == (said is not None)
    assert said is None or f"No controls: {reason}" in scene.notes


def test_a_mesh_is_taken_for_the_one_head_used_before_that_has_its_triangles(
    tmp_path: Path, head: HeadModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "heads"))
    skin = head.faces[: head.n_faces - head.n_teeth_faces]
    trimesh.Trimesh(head.v_template, skin, process=False).export(tmp_path / "mesh.ply")
    assert open_scene(tmp_path / "mesh.ply", HeadSource()).head == ""
    save_head(replace(head, name="anna"), tmp_path / "anna.npz")
    open_scene(tmp_path / "anna.npz", HeadSource())
    found = open_scene(tmp_path / "mesh.ply", HeadSource())
    assert found.head == "anna"
    assert found.rig is not None
    assert "'anna'" in found.notes[-1]
    save_head(replace(head, name="bert", weights=np.roll(head.weights, 1, axis=1)), tmp_path / "bert.npz")
    open_scene(tmp_path / "bert.npz", HeadSource())
    both = open_scene(tmp_path / "mesh.ply", HeadSource())
    assert both.head == ""
    assert "anna" in both.notes[-1]
    assert "bert" in both.notes[-1]


def test_the_largest_mesh_of_a_gltf_scene_is_read_where_its_node_puts_it(tmp_path: Path, head: HeadModel) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box())
    shift = trimesh.transformations.translation_matrix((0, 0.5, 0))
    scene.add_geometry(trimesh.Trimesh(head.v_template, head.faces, process=False), transform=shift)
    scene.export(tmp_path / "scene.glb")
    mesh = read_head_mesh(tmp_path / "scene.glb")
    assert np.array_equal(mesh.faces, head.faces)
    assert np.abs(mesh.vertices - head.v_template - (0, 0.5, 0)).max() <= ROUNDING_M


def test_coordinates_are_made_once_and_found_again(
    tmp_path: Path, head: HeadModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path))
    bare = replace(head, uv=None, uv_faces=None)
    made = unwrapped_once(bare)
    monkeypatch.setattr("sacha_core.flame.shelf.unwrapped", None)  # would be called again
    again = unwrapped_once(bare)
    assert np.array_equal(made.uv, again.uv)
    assert np.array_equal(made.uv_faces, again.uv_faces)
