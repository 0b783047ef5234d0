# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of a head's controls, and the two commands that help to use them."""

from __future__ import annotations

import bpy

from . import controls

__all__ = ["CLASSES"]

KEYS_SHOWN = 6  # lines of the list of expressions


class SachaPoseJoints(bpy.types.Operator):
    """Take the active head's joints in hand, or let them go."""

    bl_idname = "sacha.pose_joints"
    bl_label = "Pose Joints"
    bl_description = "Turn the neck, the jaw and the eyes with Blender's own tools; once more to go back to the mesh"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be joints."""
        return controls.head_of(context.object) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Go into pose mode, or out of it."""
        shown = controls.head_of(context.object)
        posing = context.object.mode == "POSE"
        bpy.ops.object.mode_set(mode="OBJECT")
        wanted, other = (shown, controls.armature_of(shown))[:: 1 if posing else -1]
        other.select_set(False)
        wanted.select_set(True)
        context.view_layer.objects.active = wanted
        if not posing:
            bpy.ops.object.mode_set(mode="POSE")
        return {"FINISHED"}


class SachaRest(bpy.types.Operator):
    """Bring the active head's controls back to rest."""

    bl_idname = "sacha.rest"
    bl_label = "Rest"
    bl_description = "Set every expression and every joint back; keyed ones come again with the next frame"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a head."""
        return controls.head_of(context.object) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set them back."""
        controls.rest(controls.head_of(context.object))
        return {"FINISHED"}


class SachaControlsPanel(bpy.types.Panel):
    """What moves the active head."""

    bl_idname = "SACHA_PT_controls"
    bl_label = "Controls"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it as it is)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for heads that were opened here, and their joints."""
        return controls.head_of(context.object) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, shown = self.layout, controls.head_of(context.object)
        keys, posing = shown.data.shape_keys, context.object.mode == "POSE"
        if keys is not None:
            layout.template_list(
                "MESH_UL_shape_keys", "", keys, "key_blocks", shown, "active_shape_key_index", rows=KEYS_SHOWN
            )
        row = layout.row(align=True)
        row.operator("sacha.pose_joints", icon="ARMATURE_DATA", depress=posing)
        row.operator("sacha.rest", icon="LOOP_BACK")
        layout.operator("sacha.load_motion", text="Load Motion...", icon="ANIM")


CLASSES = (SachaPoseJoints, SachaRest, SachaControlsPanel)
