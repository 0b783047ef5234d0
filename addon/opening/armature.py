# SPDX-License-Identifier: GPL-3.0-or-later
"""Joints as bones, and skinning: what Blender does with them is exactly what the engine's posing does.

A bone lies along the engine's y axis without roll, so that its own axes are the engine's, and a rotation of it is that of the joint.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Vector

from .. import bridge
from .scene_folder import Part

__all__ = ["PIVOT", "new_armature", "skin"]

BONE_LENGTH_M = 0.03  # as long as a thumb's end: seen, and in nobody's way
PIVOT = "SACHA joint"  # the constraint that turns a bone about where expressions move its joint
WHOLE = 1e-9  # weights below it move no vertex by a nanometre


def new_armature(
    context: bpy.types.Context, collection: bpy.types.Collection, name: str, rig: Part
) -> bpy.types.Object:
    """Make the armature of a rig, at rest, in a collection that is shown."""
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    collection.objects.link(armature)
    armature.show_in_front = True
    context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    joints = bridge.to_blender(rig.arrays["joints"])
    bones = []
    for joint, parent, at in zip(rig.values["joint_names"], rig.values["parents"], joints, strict=True):
        bone = armature.data.edit_bones.new(joint)
        bone.head = at
        bone.tail = Vector(at) + Vector((0, 0, BONE_LENGTH_M))
        bone.align_roll((0, -1, 0))
        bone.parent = bones[parent] if parent >= 0 else None
        bones.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone in armature.pose.bones:
        pivot = bone.constraints.new("PIVOT")
        pivot.name, pivot.owner_space, pivot.rotation_range = PIVOT, "LOCAL", "ALWAYS_ACTIVE"
    return armature


def skin(shown: bpy.types.Object, armature: bpy.types.Object, rig: Part) -> None:
    """Let a mesh follow the armature by linear blend skinning."""
    for joint, weights in zip(rig.values["joint_names"], rig.arrays["weights"].T, strict=True):
        group = shown.vertex_groups.new(name=joint)
        for weight, vertices in _by_weight(weights):
            group.add(vertices, weight, "REPLACE")
    modifier = shown.modifiers.new(armature.name, "ARMATURE")
    modifier.object = armature
    modifier.use_deform_preserve_volume = False
    shown.parent = armature


def _by_weight(weights: np.ndarray) -> Iterator[tuple[float, list[int]]]:
    """Give each weight that counts with the vertices that have it, for a group takes many vertices of one weight at once."""
    vertices = np.flatnonzero(weights > WHOLE)
    vertices = vertices[np.argsort(weights[vertices], kind="stable")]
    different = np.flatnonzero(np.diff(weights[vertices])) + 1
    for alike in np.split(vertices, different) if len(vertices) else ():
        yield float(weights[alike[0]]), alike.tolist()
