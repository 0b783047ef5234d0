# SPDX-License-Identifier: GPL-3.0-or-later
"""Expressions and pose correctives as shape keys."""

from __future__ import annotations

import bpy
import numpy as np

from .. import bridge
from ..features import key_points
from .scene_folder import Part

__all__ = ["corrective_name", "new_corrective_keys", "new_expression_keys"]

CORRECTIVE_RANGE = (-2.0, 2.0)  # the entries of a rotation less those of the identity


def corrective_name(rig: Part, entry: int) -> str:
    """Name the shape key that corrects one entry of a joint's rotation matrix, row and column counted from 0."""
    joint, place = divmod(int(entry), 9)
    return f"corrective {rig.values['joint_names'][joint + 1]} {place // 3}{place % 3}"


def new_expression_keys(shown: bpy.types.Object, rig: Part) -> list[bpy.types.ShapeKey]:
    """Give a mesh a shape key for each expression."""
    ranges = rig.arrays["ranges"].tolist()
    shown.shape_key_add(name="Basis", from_mix=False)
    return _new_keys(shown, rig.values["names"], rig.arrays["directions"], ranges)


def new_corrective_keys(shown: bpy.types.Object, rig: Part) -> list[bpy.types.ShapeKey]:
    """Give a mesh a shape key for each pose corrective."""
    entries = rig.arrays["corrective_entries"]
    names = [corrective_name(rig, entry) for entry in entries]
    return _new_keys(shown, names, rig.arrays["correctives"], [CORRECTIVE_RANGE] * len(names))


def _new_keys(
    shown: bpy.types.Object, names: list[str], directions: np.ndarray, ranges: list[tuple[float, float]]
) -> list[bpy.types.ShapeKey]:
    rest = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", rest)
    keys = []
    for name, moved, (least, largest) in zip(names, directions, ranges, strict=True):
        key = shown.shape_key_add(name=name, from_mix=False)
        key.slider_min, key.slider_max, key.value = least, largest, 0.0
        key_points(key).foreach_set("co", rest + bridge.to_blender(moved).ravel())
        keys.append(key)
    return keys
