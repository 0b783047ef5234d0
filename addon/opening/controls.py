# SPDX-License-Identifier: GPL-3.0-or-later
"""The controls of a head, kept with its mesh, and what they are set to in the engine's terms."""

from __future__ import annotations

import json

import bpy
import numpy as np
from bpy.props import CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty
from mathutils import Matrix

from .. import bridge
from .armature import PIVOT
from .scene_folder import Part

__all__ = [
    "CLASSES",
    "SHAPE",
    "armature_of",
    "attach",
    "describe",
    "detach",
    "head_of",
    "head_options",
    "motion_frame",
    "neutral",
    "read",
    "remember_head",
    "rest",
]

SHAPE = "sacha_shape"  # property of a mesh: the identity coefficients of its person
RIGID_ERROR = 1e-4  # of the entries of an object's matrix: rounding, and hands that nearly let it be


class SachaExpression(bpy.types.PropertyGroup):
    """One expression, or identity component; `name` is that of its shape key."""

    scale: FloatProperty(default=1.0, description="The coefficient that a value of 1 stands for")


class SachaRig(bpy.types.PropertyGroup):
    """The controls of a head, kept with its mesh."""

    expressions: CollectionProperty(type=SachaExpression)
    n_identity: IntProperty(description="How many of the first are identity components, on a head that is nobody's yet")
    head_options: StringProperty(description="What the engine was told of its head, as JSON")
    n_frames: IntProperty(description="Frames of the motion that it was opened with; 0 for none")
    first_frame: FloatProperty(description="Frame of the scene at which the motion's first frame lies")
    frame_step: FloatProperty(default=1.0, description="Frames of the scene from one frame of the motion to the next")


CLASSES = (SachaExpression, SachaRig)


def attach() -> None:
    """Give meshes what their controls are."""
    bpy.types.Mesh.sacha_rig = PointerProperty(type=SachaRig)


def detach() -> None:
    """Take it away again."""
    del bpy.types.Mesh.sacha_rig


def describe(mesh: bpy.types.Mesh, keys: list[bpy.types.ShapeKey], rig: Part) -> None:
    """Keep with a mesh what is needed to read its controls: the shape keys by the names that Blender gave them."""
    for key, scale in zip(keys, rig.arrays["scales"].tolist(), strict=True):
        expression = mesh.sacha_rig.expressions.add()
        expression.name, expression.scale = key.name, scale
    mesh.sacha_rig.n_identity = rig.values["n_identity"]
    mesh[SHAPE] = rig.arrays["shape"].astype(np.float64).tolist()


def remember_head(mesh: bpy.types.Mesh, options: list[str]) -> None:
    """Keep with a mesh what the engine was told of its head."""
    mesh.sacha_rig.head_options = json.dumps(options)


def head_options(mesh: bpy.types.Mesh) -> list[str]:
    """Give what the engine was told of a mesh's head."""
    return json.loads(mesh.sacha_rig.head_options or "[]")


def head_of(thing: bpy.types.Object | None) -> bpy.types.Object | None:
    """Give the head that an object is or moves: itself, or the mesh whose joints it is; None where it is neither."""
    if thing is None:
        return None
    candidates = [thing] if thing.type == "MESH" else [item for item in thing.children if item.type == "MESH"]
    return next((item for item in candidates if item.data.sacha.kind and armature_of(item)), None)


def armature_of(shown: bpy.types.Object) -> bpy.types.Object | None:
    """Give the armature that moves a head; None where it has none."""
    armatures = [modifier.object for modifier in shown.modifiers if modifier.type == "ARMATURE"]
    return next((armature for armature in armatures if armature is not None), None)


def rest(shown: bpy.types.Object) -> None:
    """Set a head's expressions to nothing and its joints to where they were opened; who it is stays."""
    keys, armature, rig = shown.data.shape_keys, armature_of(shown), shown.data.sacha_rig
    for expression in rig.expressions[rig.n_identity :]:
        if keys is not None and expression.name in keys.key_blocks:
            keys.key_blocks[expression.name].value = 0.0
    for bone in () if armature is None else armature.pose.bones:
        bone.location, bone.scale = (0, 0, 0), (1, 1, 1)
        bone.rotation_quaternion, bone.rotation_euler = (1, 0, 0, 0), (0, 0, 0)
        bone.rotation_axis_angle = (0, 0, 1, 0)


def motion_frame(shown: bpy.types.Object, scene: bpy.types.Scene) -> int | None:
    """Give the frame of the motion that is nearest to the scene's current one; None where the head came without motion."""
    rig = shown.data.sacha_rig
    if not rig.n_frames:
        return None
    frame = round((scene.frame_current_final - rig.first_frame) / rig.frame_step)
    return min(max(frame, 0), rig.n_frames - 1)


def read(shown: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> dict[str, np.ndarray]:
    """Read what the controls are set to, as evaluated, by hand, keys or drivers.

    Args:
        shown: the mesh of a head that was opened here.
        depsgraph: evaluated at the frame.

    Returns:
        FLAME parameters of one frame in the engine's axes: `expression` (e,), `rotation`, `neck`, `jaw` (3,), `eyes` (6,) axis-angle in
        radians, `translation` (3,) metres, and `shape` (s,) of the person. Where the objects stand is part of rotation and translation.

    Raises:
        ValueError: the head has lost its armature, a joint or an expression, or was scaled or moved apart from its joints.
    """
    armature, keys = armature_of(shown), shown.data.shape_keys
    if armature is None or keys is None:
        raise ValueError(f"{shown.name} has no controls: open its file again")
    blocks = keys.evaluated_get(depsgraph).key_blocks
    missing = [item.name for item in shown.data.sacha_rig.expressions if item.name not in blocks]
    if missing:
        raise ValueError(f"{shown.name} has lost its shape key {missing[0]!r}: open its file again")
    values = [blocks[item.name].value * item.scale for item in shown.data.sacha_rig.expressions]
    n_identity = shown.data.sacha_rig.n_identity
    shape = values[:n_identity] if n_identity else shown.data.get(SHAPE, [])
    evaluated = armature.evaluated_get(depsgraph)
    bones = evaluated.pose.bones
    if "root" not in bones:
        raise ValueError(f"{armature.name} has lost its joint 'root': open the head's file again")
    apart = np.array(shown.evaluated_get(depsgraph).matrix_world) - np.array(evaluated.matrix_world)
    if np.abs(apart).max() > RIGID_ERROR:
        raise ValueError(f"{shown.name} was moved apart from its joints: move {armature.name} instead")
    rotation, translation = _placed(evaluated, bones["root"])
    turns = {joint: np.array(_turn(bones, joint)) for joint in ("neck", "jaw", "left_eye", "right_eye")}
    return {
        "shape": np.array(shape, np.float32),
        "expression": np.array(values[n_identity:], np.float32),
        "rotation": rotation.astype(np.float32),
        "neck": turns["neck"].astype(np.float32),
        "jaw": turns["jaw"].astype(np.float32),
        "eyes": np.concatenate([turns["left_eye"], turns["right_eye"]]).astype(np.float32),
        "translation": translation.astype(np.float32),
    }


def neutral(shown: bpy.types.Object) -> np.ndarray:
    """Give (v, 3) vertices of the person's neutral head in the engine's axes, as sculpted, with its identity components as they are set."""
    keys, rig = shown.data.shape_keys, shown.data.sacha_rig
    rest = _points(keys.reference_key)
    found = rest.copy()
    for component in rig.expressions[: rig.n_identity]:
        block = keys.key_blocks[component.name]
        found += block.value * (_points(block) - rest)
    return bridge.to_engine(found)


def _points(key: bpy.types.ShapeKey) -> np.ndarray:
    values = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", values)
    return values.reshape(-1, 3)


def _turn(bones: bpy.types.bpy_prop_collection, joint: str) -> tuple[float, ...]:
    """Give the rotation vector of a joint relative to its parent; zero where a rig has no such joint."""
    if joint not in bones:
        return (0.0, 0.0, 0.0)
    return tuple(_local(bones[joint]).to_quaternion().to_exponential_map())


def _local(bone: bpy.types.PoseBone) -> Matrix:
    """Give a bone's pose relative to its parent and its rest, whatever brought it about."""
    parent = bone.parent
    if parent is None:
        return bone.bone.matrix_local.inverted() @ bone.matrix
    rest = parent.bone.matrix_local.inverted() @ bone.bone.matrix_local
    return rest.inverted() @ parent.matrix.inverted() @ bone.matrix


def _placed(armature: bpy.types.Object, root: bpy.types.PoseBone) -> tuple[np.ndarray, np.ndarray]:
    """Give rotation vector and translation of the root joint in the world."""
    world = armature.matrix_world
    if max(abs(side - 1) for side in world.to_scale()) > RIGID_ERROR:
        raise ValueError(f"{armature.name} is scaled, which no head's parameters can say: set its scale to 1")
    rest = root.bone.matrix_local
    joint = rest @ root.constraints[PIVOT].offset if PIVOT in root.constraints else rest.translation
    moved = world @ root.matrix @ rest.inverted()
    turned = rest.to_3x3().inverted() @ moved.to_3x3() @ rest.to_3x3()
    translation = bridge.to_engine(np.array([moved @ joint - joint]))[0]
    return np.array(turned.to_quaternion().to_exponential_map()), translation
