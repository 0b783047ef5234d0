# SPDX-License-Identifier: GPL-3.0-or-later
"""The controls of an opened head: shape keys, an armature, and what ties them together."""

from __future__ import annotations

import bpy

from . import animating, armature, controls, drivers, shape_keys
from .scene_folder import SceneFolder

__all__ = ["rig_up"]


def rig_up(context: bpy.types.Context, shown: bpy.types.Object, opened: SceneFolder) -> list[str]:
    """Give an opened head its controls and its motion; one of no known head model gets none.

    Returns:
        Notes for the user.
    """
    rig = opened.parts.get("rig")
    if rig is None:
        return []
    expressions = shape_keys.new_expression_keys(shown, rig)
    correctives = shape_keys.new_corrective_keys(shown, rig)
    joints = armature.new_armature(context, shown.users_collection[0], f"{shown.name} joints", rig)
    armature.skin(shown, joints, rig)
    drivers.correct_poses(joints, correctives, rig)
    drivers.move_joints(joints, expressions, rig)
    controls.describe(shown.data, expressions, rig)
    animation = opened.parts.get("animation")
    return [] if animation is None else animating.animate(context, shown, animation, rig)
