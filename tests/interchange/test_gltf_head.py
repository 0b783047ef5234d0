"""Oracles: the Khronos Group's validator, and a naive player of glTF, from its specification, against our own posing."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from glb_reading import Glb, validated
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.flame.unwrap import unwrapped
from sacha_core.geometry.quaternion import to_matrix
from sacha_core.interchange.gltf_head import write_gltf_head

VERTEX_ERROR_M = 2e-6  # float32 in the file, of numbers up to a few metres in the head of random numbers
FRAME_RATE = 30.0


def moving(head: HeadModel, n_frames: int = 4, seed: int = 1) -> Motion:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return (rng.normal(size=shape) / 2).astype(np.float32)

    dynamic = {"expression": normal(n_frames, head.exprdirs.shape[2]), "rotation": normal(n_frames, 3)}
    dynamic |= {"neck": normal(n_frames, 3), "jaw": normal(n_frames, 3), "eyes": normal(n_frames, 6)}
    offset = normal(head.n_vertices, 3) / 500
    return Motion(normal(head.shapedirs.shape[2]), offset, **dynamic, translation=normal(n_frames, 3))


def random_head(**changes: object) -> HeadModel:
    rng = np.random.default_rng(0)

    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    weights, regressor = rng.random((30, 5)), rng.random((5, 30))
    made = HeadModel(
        "random", normal(30, 3), np.array([rng.choice(29, 3, replace=False) for _ in range(40)], np.int32),
        normal(30, 3, 6) / 10, normal(30, 3, 7) / 10, (regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32), np.array([-1, 0, 1, 1, 1], np.int32),
        normal(30, 3, 36) / 10,
    )  # fmt: skip
    return replace(made, **changes)


def rig() -> HeadModel:
    names = tuple(f"shape{i}" for i in range(7))
    return random_head(
        weights=np.ones((30, 1), np.float32), parents=np.array([-1], np.int32), posedirs=None, expression_names=names,
        J_regressor=np.full((1, 30), 1 / 30, np.float32),
    )  # fmt: skip


HEADS = {
    "random, every term": random_head,
    "rig of blend shapes": rig,
    "synthetic": lambda: synthetic_head("small"),
    "unwrapped": lambda: unwrapped(random_head()),
}


@pytest.fixture(scope="module", params=HEADS)
def head(request: pytest.FixtureRequest) -> HeadModel:
    return HEADS[request.param]()


def node_matrix(node: dict[str, object], pose: dict[str, np.ndarray]) -> np.ndarray:
    matrix = np.eye(4)
    x, y, z, w = pose.get("rotation", np.array(node.get("rotation", (0, 0, 0, 1)), float)).astype(float)
    matrix[:3, :3] = to_matrix(np.array([w, x, y, z]))
    matrix[:3, 3] = pose.get("translation", np.array(node.get("translation", (0, 0, 0)), float))
    return matrix


def played(glb: Glb, frame: int | None) -> np.ndarray:
    """Give the posed vertices of the file at a key frame, or at rest, by the specification's sections 3.7.2.2 and 3.7.3."""
    document = glb.document
    poses: dict[int, dict[str, np.ndarray]] = {}
    if frame is not None:
        (animation,) = document["animations"]
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times, values = glb.array(sampler["input"]), glb.array(sampler["output"])
            assert times[frame] == np.float32(frame / FRAME_RATE)
            target = channel["target"]
            poses.setdefault(target["node"], {})[target["path"]] = values.reshape(len(times), -1)[frame]
    globals_: dict[int, np.ndarray] = {}

    def visit(number: int, above: np.ndarray) -> None:
        node = document["nodes"][number]
        globals_[number] = above @ node_matrix(node, poses.get(number, {}))
        for child in node.get("children", ()):
            visit(child, globals_[number])

    for root in document["scenes"][0]["nodes"]:
        visit(root, np.eye(4))
    (mesh,), (skin,) = document["meshes"], document["skins"]
    (primitive,) = mesh["primitives"]
    weights = poses.get(0, {}).get("weights", mesh.get("weights", []))
    vertices = glb.array(primitive["attributes"]["POSITION"]).astype(float)
    for weight, target in zip(weights, primitive.get("targets", ()), strict=True):
        vertices = vertices + weight.astype(float) * glb.array(target["POSITION"]) if frame is not None else vertices
    unmove = glb.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2).astype(float)
    matrices = np.stack([globals_[joint] @ back for joint, back in zip(skin["joints"], unmove, strict=True)])
    blended = np.zeros((len(vertices), 4, 4))
    for number in range(2):
        if f"JOINTS_{number}" in primitive["attributes"]:
            joints = glb.array(primitive["attributes"][f"JOINTS_{number}"])
            shares = glb.array(primitive["attributes"][f"WEIGHTS_{number}"]).astype(float)
            blended += np.einsum("ms,msij->mij", shares, matrices[joints])
    return np.einsum("mij,mj->mi", blended[:, :3, :3], vertices) + blended[:, :3, 3]


def surface(glb: Glb, vertices: np.ndarray) -> np.ndarray:
    """Give the corners of triangles, which are the same however vertices were split."""
    faces = glb.array(glb.document["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)
    return vertices[faces]


def complaints(path: Path) -> list[dict[str, object]]:
    """Give the validator's, but for coordinates without a picture, which are there for whoever puts one there later."""
    return [one for one in validated(path) if (one["code"], one["pointer"][-10:]) != ("UNUSED_OBJECT", "TEXCOORD_0")]


def png() -> bytes:
    stream = io.BytesIO()
    Image.fromarray(np.arange(64, dtype=np.uint8).reshape(8, 8)).save(stream, "PNG")
    return stream.getvalue()


def test_played_frames_are_the_posed_head(head: HeadModel, tmp_path: Path) -> None:
    motion = moving(head)
    write_gltf_head(tmp_path / "a.glb", head, motion, FRAME_RATE)
    glb, poser = Glb(tmp_path / "a.glb"), Poser(head, motion, np.float64)
    rest = surface(glb, played(glb, None))
    np.testing.assert_allclose(rest, poser.template[head.faces], atol=VERTEX_ERROR_M)
    for frame in range(len(motion)):
        shown = surface(glb, played(glb, frame))
        np.testing.assert_allclose(shown, poser(frame)[head.faces], atol=VERTEX_ERROR_M)
    assert np.abs(surface(glb, played(glb, 0)) - rest).max() > 0.05  # it moves


@pytest.mark.parametrize("picture", [None, png()], ids=["grey", "picture"])
def test_khronos_validator_has_nothing_to_say(head: HeadModel, tmp_path: Path, picture: bytes | None) -> None:
    write_gltf_head(tmp_path / "a.glb", head, moving(head), FRAME_RATE, picture)
    assert complaints(tmp_path / "a.glb") == []


def test_the_picture_lies_where_the_texture_coordinates_say(tmp_path: Path) -> None:
    head = unwrapped(random_head())
    write_gltf_head(tmp_path / "a.glb", head, moving(head), FRAME_RATE, png())
    glb = Glb(tmp_path / "a.glb")
    assert glb.view(glb.document["images"][0]["bufferView"]) == png()
    uv = surface(glb, glb.array(glb.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]))
    np.testing.assert_allclose(uv[:, :, 0], head.uv[head.uv_faces][:, :, 0])
    np.testing.assert_allclose(1 - uv[:, :, 1], head.uv[head.uv_faces][:, :, 1], atol=1e-6)  # glTF's starts at the top


def test_blend_shapes_bear_their_names(tmp_path: Path) -> None:
    write_gltf_head(tmp_path / "a.glb", rig(), moving(rig()), FRAME_RATE)
    assert Glb(tmp_path / "a.glb").document["meshes"][0]["extras"]["targetNames"] == list(rig().expression_names)
    write_gltf_head(tmp_path / "a.glb", random_head(), moving(random_head()), FRAME_RATE)
    names = Glb(tmp_path / "a.glb").document["meshes"][0]["extras"]["targetNames"]
    assert names[:2] == ["expression_000", "expression_001"]
    assert names[7:9] == ["neck_xx", "neck_xy"]
    assert len(names) == len(set(names)) == 7 + 36


def test_a_head_without_a_motion_stands_still(tmp_path: Path) -> None:
    head = synthetic_head("small")
    write_gltf_head(tmp_path / "a.glb", head, Motion.rest(0, head.exprdirs.shape[2], 0), FRAME_RATE)
    glb = Glb(tmp_path / "a.glb")
    assert "animations" not in glb.document
    np.testing.assert_allclose(surface(glb, played(glb, None)), head.v_template[head.faces], atol=VERTEX_ERROR_M)
    assert complaints(tmp_path / "a.glb") == []
