# SPDX-License-Identifier: GPL-3.0-or-later
"""What follows from the controls without anybody's doing: correctives from rotations, and joints from expressions.

All are expressions that Blender works out itself, without Python, so that a .blend goes on working where the add-on is not installed.
"""

from __future__ import annotations

from string import ascii_letters

import bpy
import numpy as np

from .armature import PIVOT
from .scene_folder import Part

__all__ = ["correct_poses", "move_joints"]

# Entries of R - I, row after row, of a unit quaternion w, x, y, z.
ENTRIES = (
    "-2*(y*y+z*z)", "2*(x*y-w*z)", "2*(x*z+w*y)",
    "2*(x*y+w*z)", "-2*(x*x+z*z)", "2*(y*z-w*x)",
    "2*(x*z-w*y)", "2*(y*z+w*x)", "-2*(x*x+y*y)",
)  # fmt: skip
UNIT_M = 1e-9  # sums of joints count nanometres, so that their factors are short whole numbers
LONGEST_EXPRESSION = 240  # of the 255 characters that a driver's expression may have
LETTERS = ascii_letters.replace("e", "")  # `e` is also how powers of ten are written


def correct_poses(armature: bpy.types.Object, keys: list[bpy.types.ShapeKey], rig: Part) -> None:
    """Drive each corrective by the rotation of its joint, however that comes about."""
    for key, entry in zip(keys, rig.arrays["corrective_entries"].tolist(), strict=True):
        joint, place = divmod(entry, 9)
        driver = _driver(key, "value")
        for letter in "wxyz":
            if letter in ENTRIES[place]:
                variable = driver.variables.new()
                variable.name, variable.type = letter, "TRANSFORMS"
                target = variable.targets[0]
                target.id, target.bone_target = armature, rig.values["joint_names"][joint + 1]
                target.transform_type, target.rotation_mode = f"ROT_{letter.upper()}", "QUATERNION"
                target.transform_space = "LOCAL_SPACE"
        driver.expression = ENTRIES[place]


def move_joints(armature: bpy.types.Object, keys: list[bpy.types.ShapeKey], rig: Part) -> None:
    """Let each joint turn about where the expressions move it.

    A sum that is too long for one expression is made of parts, which are properties of the armature.
    """
    factors = np.rint(rig.arrays["joint_directions"] / UNIT_M).astype(np.int64)  # (k, j, 3)
    for number, joint in enumerate(rig.values["joint_names"]):
        pivot = armature.pose.bones[joint].constraints[PIVOT]
        for axis in range(3):
            of_keys = [(key, int(n)) for key, n in zip(keys, factors[:, number, axis], strict=True) if n]
            chunks = list(_chunks(of_keys))
            if len(chunks) == 1:
                _sum_keys(_driver(pivot, "offset", axis), chunks[0])
            elif chunks:
                _sum_parts(armature, _driver(pivot, "offset", axis), f"{joint} {'xyz'[axis]}", chunks)


def _driver(owner: bpy.types.bpy_struct, path: str, index: int = -1) -> bpy.types.Driver:
    """Add a driver whose value is that of its expression, unchanged.

    From Blender 5.0 on, a new driver's curve has keys at 0 and 1, and what comes within 0.0001 of one of them is made equal to it.
    """
    curve = owner.driver_add(path, index)
    curve.keyframe_points.clear()
    return curve.driver


def _chunks(of_keys: list[tuple[bpy.types.ShapeKey, int]]) -> list[list[tuple[bpy.types.ShapeKey, int]]]:
    """Cut a sum into parts that an expression holds."""
    chunks, length = [], LONGEST_EXPRESSION
    for key, factor in of_keys:
        term = len(f"{factor:+d}*a")
        if length + term > LONGEST_EXPRESSION or len(chunks[-1]) == len(LETTERS):
            chunks.append([])
            length = len(f"{UNIT_M}*()")
        chunks[-1].append((key, factor))
        length += term
    return chunks


def _sum_keys(driver: bpy.types.Driver, of_keys: list[tuple[bpy.types.ShapeKey, int]]) -> None:
    """Drive by a sum of the values of shape keys, each times its factor in nanometres."""
    terms = []
    for letter, (key, factor) in zip(LETTERS, of_keys, strict=False):
        _read(driver, letter, "KEY", key.id_data, key.path_from_id("value"))
        terms.append(f"{factor:+d}*{letter}")
    driver.expression = f"{UNIT_M}*({''.join(terms)})"


def _sum_parts(
    armature: bpy.types.Object,
    driver: bpy.types.Driver,
    name: str,
    chunks: list[list[tuple[bpy.types.ShapeKey, int]]],
) -> None:
    """Drive by a sum of sums, which the armature keeps."""
    letters = LETTERS[: len(chunks)]
    for letter, chunk in zip(letters, chunks, strict=True):
        part = f"{name} {letter}"
        armature[part] = 0.0
        path = f'["{bpy.utils.escape_identifier(part)}"]'
        _sum_keys(_driver(armature, path), chunk)
        _read(driver, letter, "OBJECT", armature, path)
    driver.expression = "+".join(letters)


def _read(driver: bpy.types.Driver, name: str, kind: str, owner: bpy.types.ID, path: str) -> None:
    """Give a driver a variable that is a property of some data."""
    variable = driver.variables.new()
    variable.name = name
    target = variable.targets[0]
    target.id_type = kind
    target.id, target.data_path = owner, path
