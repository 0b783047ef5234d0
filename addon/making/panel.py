# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of files: encode and decode the avatar that is shown."""

from __future__ import annotations

import bpy

from ..seeing.shown import shown_by

__all__ = ["CLASSES"]


class SachaFilesPanel(bpy.types.Panel):
    """Encode and decode the avatar that is shown."""

    bl_idname = "SACHA_PT_files"
    bl_label = "Compress"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 40

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only an avatar has Gaussians to compress."""
        shown = shown_by(context)
        return shown is not None and shown.kind == "avatar"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, chosen = self.layout, context.scene.sacha
        layout.use_property_split = True
        layout.prop(chosen, "level")
        layout.prop(chosen, "motion")
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("sacha.encode", text="Encode...", icon="EXPORT")
        row.operator("sacha.decode", text="Decode...", icon="IMPORT")


CLASSES = (SachaFilesPanel,)
