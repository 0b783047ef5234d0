"""A head as plain glTF, which any engine plays: a skinned mesh with blend shapes, its motion as an animation, a picture on its skin.

FLAME is more than a skinned mesh: joints move with the expression, and poses correct the shape. Both fit into what glTF has. The
correctives are further blend shapes, whose weights the animation gives; and where a joint has moved, its node stands where skinning from
the joint's place at rest comes to the same. At every frame of the motion vertices are those of `Poser`.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.model import JOINTS, HeadModel
from sacha_core.flame.posing import HeadMotion, Poser, joint_vectors
from sacha_core.geometry import quaternion
from sacha_core.geometry.rotation import rotation_vectors_to_matrices
from sacha_core.geometry.skinning import joint_transforms
from sacha_core.interchange.glb import Glb

__all__ = ["write_gltf_head"]

PER_SET = 4  # joints in one attribute of a vertex
NEAREST, LINEAR = 9728, 9729  # filters: a map's colours stay its own from near
GREY = (0.7, 0.7, 0.7, 1.0)
ROUGH = {"metallicFactor": 0.0, "roughnessFactor": 1.0}


class _Corners(NamedTuple):
    """Vertices as glTF has them, which keep one texture coordinate each: seams split them.

    Args:
        vertex: (m,) of the head.
        uv: (m, 2) from the top left, or None.
        faces: (f, 3) indices into both.
    """

    vertex: Int[np.ndarray, " m"]
    uv: Float[np.ndarray, "m 2"] | None
    faces: Int[np.ndarray, "f 3"]


def write_gltf_head(
    path: str | os.PathLike[str], head: HeadModel, motion: HeadMotion, frame_rate: float, picture: bytes | None = None
) -> None:
    """Write a head and what it does as a binary glTF file.

    Args:
        path: the `.glb` file.
        head: the head model; where it has texture coordinates, the picture goes there.
        motion: whose static parameters make the person, whose frames become the animation; with none there is no animation.
        frame_rate: frames a second.
        picture: a PNG for the skin; None for plain grey.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        OSError: the file cannot be written.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017; Khronos Group, glTF 2.0 Specification, section 3.7.
    """
    glb, poser, corners = Glb(), Poser(head, motion, np.float64), _corners(head)
    targets = poser.directions.reshape(len(poser.directions), -1, 3)
    names = _target_names(head, poser.expressions.shape[1], len(targets))
    first_joint, joints = 1, range(1, 1 + len(poser.parents))
    glb.document |= {
        "scenes": [{"nodes": [0, first_joint]}],
        "nodes": [{"name": head.name, "mesh": 0, "skin": 0}, *_joint_nodes(poser, first_joint)],
        "skins": [
            {"joints": list(joints), "skeleton": first_joint, "inverseBindMatrices": _unmoved(glb, poser.joints)}
        ],
        "meshes": [_mesh(glb, poser, corners, targets, names)],
        "materials": [_material(glb, picture if corners.uv is not None else None)],
    }
    if len(poser):
        glb.document["animations"] = [_animation(glb, poser, motion, frame_rate, first_joint)]
    glb.write(path)


def _corners(head: HeadModel) -> _Corners:
    """Split vertices that have several texture coordinates; those without a triangle stay."""
    if head.uv is None or head.uv_faces is None:
        return _Corners(np.arange(head.n_vertices), None, head.faces)
    pairs = np.stack([head.faces.reshape(-1), head.uv_faces.reshape(-1)], axis=1)
    alone = np.setdiff1d(np.arange(head.n_vertices), head.faces)
    kept, place = np.unique(
        np.concatenate([pairs, np.stack([alone, np.zeros_like(alone)], axis=1)]), axis=0, return_inverse=True
    )
    uv = head.uv[kept[:, 1]] * [1, -1] + [0, 1]
    return _Corners(kept[:, 0], uv, place.reshape(-1)[: len(pairs)].reshape(-1, 3))


def _target_names(head: HeadModel, n_expressions: int, n_targets: int) -> list[str]:
    """Name the blend shapes: expressions, and then for each joint but the root the entries of its rotation matrix."""
    names = list(head.expression_names[:n_expressions]) or [f"expression_{i:03d}" for i in range(n_expressions)]
    entries = [f"{joint}_{i}{k}" for joint in JOINTS[1:] for i in "xyz" for k in "xyz"]
    return names + entries[: n_targets - n_expressions]


def _joint_nodes(poser: Poser, first: int) -> list[dict[str, Any]]:
    """Give a node for each joint, at rest."""
    nodes: list[dict[str, Any]] = []
    for joint, parent in enumerate(poser.parents):
        place = poser.joints[joint] - (poser.joints[parent] if parent >= 0 else 0)
        children = [first + int(child) for child in np.flatnonzero(poser.parents == joint)]
        nodes.append(
            {"name": JOINTS[joint], "translation": place.tolist()} | ({"children": children} if children else {})
        )
    return nodes


def _unmoved(glb: Glb, joints: Float[np.ndarray, "j 3"]) -> int:
    """Add the matrices that take each joint at rest to the origin."""
    matrices = np.tile(np.eye(4, dtype=np.float32), (len(joints), 1, 1))
    matrices[:, :3, 3] = -joints
    return glb.add(matrices)


def _mesh(
    glb: Glb, poser: Poser, corners: _Corners, targets: Float[np.ndarray, "k v 3"], names: list[str]
) -> dict[str, Any]:
    """Add the surface and its blend shapes."""
    attributes = {
        "POSITION": glb.add_vertices(_float32(poser.template[corners.vertex]), bounds=True),
        "NORMAL": glb.add_vertices(_float32(_normals(poser.template, corners))),
    }
    if corners.uv is not None:
        attributes["TEXCOORD_0"] = glb.add_vertices(_float32(corners.uv))
    for number, (joints, weights) in enumerate(_influences(poser.weights[corners.vertex])):
        attributes[f"JOINTS_{number}"] = glb.add_vertices(joints)
        attributes[f"WEIGHTS_{number}"] = glb.add_vertices(weights)
    primitive: dict[str, Any] = {"attributes": attributes, "indices": glb.add_indices(corners.faces), "material": 0}
    if not len(targets):
        return {"name": "head", "primitives": [primitive]}
    shapes = (_float32(target[corners.vertex]) for target in targets)
    primitive["targets"] = [{"POSITION": glb.add_vertices(shape, bounds=True)} for shape in shapes]
    extras = {"targetNames": names}
    return {"name": "head", "primitives": [primitive], "weights": [0.0] * len(targets), "extras": extras}


def _normals(vertices: Float[np.ndarray, "v 3"], corners: _Corners) -> Float[np.ndarray, "m 3"]:
    """Give unit normals, smooth over seams; a vertex that no triangle uses looks ahead."""
    faces = corners.vertex[corners.faces]
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)  # as long as twice the triangle's area
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.where(lengths > 0, normals / np.maximum(lengths, np.finfo(np.float64).tiny), [0.0, 0.0, 1.0])
    chosen: np.ndarray = unit[corners.vertex]
    return chosen


def _influences(weights: Float[np.ndarray, "m j"]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Give joints and weights in sets of four, strongest first; as many sets as some vertex needs."""
    order = np.argsort(-weights, axis=1, kind="stable").astype(np.uint8)
    sorted_weights = np.take_along_axis(weights, order, axis=1) / weights.sum(axis=1, keepdims=True)
    n_sets = -(-max(int((weights > 0).sum(axis=1).max()), 1) // PER_SET)
    room = ((0, 0), (0, max(n_sets * PER_SET - weights.shape[1], 0)))
    order, sorted_weights = np.pad(order, room), np.pad(sorted_weights, room)
    order[sorted_weights == 0] = 0  # glTF wants no other joint named without a weight
    parts = [slice(start, start + PER_SET) for start in range(0, n_sets * PER_SET, PER_SET)]
    return [(np.ascontiguousarray(order[:, part]), _float32(sorted_weights[:, part])) for part in parts]


def _material(glb: Glb, picture: bytes | None) -> dict[str, Any]:
    if picture is None:
        return {"name": "skin", "doubleSided": True, "pbrMetallicRoughness": ROUGH | {"baseColorFactor": GREY}}
    glb.document |= {
        "images": [{"name": "skin", "mimeType": "image/png", "bufferView": glb.add_view(picture)}],
        "samplers": [{"magFilter": NEAREST, "minFilter": LINEAR}],
        "textures": [{"sampler": 0, "source": 0}],
    }
    return {"name": "skin", "doubleSided": True, "pbrMetallicRoughness": ROUGH | {"baseColorTexture": {"index": 0}}}


def _animation(glb: Glb, poser: Poser, motion: HeadMotion, frame_rate: float, first: int) -> dict[str, Any]:
    """Add the motion: a rotation and a translation of each joint that moves, and the weights of the blend shapes."""
    times = glb.add(_float32(np.arange(len(poser)) / frame_rate), bounds=True)
    turns, places, weights = _tracks(poser, motion)
    tracks: list[tuple[int, str, np.ndarray]] = []
    for joint in range(len(poser.parents)):
        tracks += [(first + joint, "rotation", turns[:, joint]), (first + joint, "translation", places[:, joint])]
    if weights.shape[1]:
        tracks.append((0, "weights", weights.reshape(-1)))
    samplers = [
        {"input": times, "output": glb.add(_float32(values)), "interpolation": "LINEAR"} for _, _, values in tracks
    ]
    channels = [
        {"sampler": number, "target": {"node": node, "path": kind}} for number, (node, kind, _) in enumerate(tracks)
    ]
    return {"name": "motion", "samplers": samplers, "channels": channels}


def _tracks(
    poser: Poser, motion: HeadMotion
) -> tuple[Float[np.ndarray, "t j 4"], Float[np.ndarray, "t j 3"], Float[np.ndarray, "t k"]]:
    """Give for each frame the turn (xyzw) and the place of each joint's node in its parent's, and the blend shapes' weights."""
    n, j = len(poser), len(poser.parents)
    turns, places, weights = np.empty((n, j, 4)), np.empty((n, j, 3)), np.empty((n, len(poser.directions)))
    for frame in range(n):
        rotations = rotation_vectors_to_matrices(joint_vectors(motion, frame).astype(np.float64)[:j])
        expression = poser.expressions[frame]
        _, joints = poser.unposed(expression, rotations)
        maps = joint_transforms(rotations, joints, poser.parents)
        stands = np.einsum("jik,jk->ji", maps[:, :, :3], poser.joints) + maps[:, :, 3] + motion.translation[frame]
        correctives = (rotations[1:] - np.eye(3)).reshape(-1) if poser.has_correctives else np.zeros(0)
        weights[frame] = np.concatenate([expression, correctives])
        for joint, parent in enumerate(poser.parents):
            above = maps[parent, :, :3] if parent >= 0 else np.eye(3)
            places[frame, joint] = above.T @ (stands[joint] - (stands[parent] if parent >= 0 else 0))
        turns[frame] = quaternion.from_matrix(rotations)[:, [1, 2, 3, 0]]
        if frame:  # the nearer of the two quaternions of a rotation, as blending between frames wants it
            turns[frame] *= np.where((turns[frame] * turns[frame - 1]).sum(axis=1, keepdims=True) < 0, -1, 1)
    return turns, places, weights


def _float32(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, np.float32)
