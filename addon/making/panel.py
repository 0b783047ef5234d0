# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of files: encode and decode the avatar that is shown, or whole folders."""

from __future__ import annotations

import bpy

from ..seeing.shown import shown_by

__all__ = ["CLASSES"]


class SachaFilesPanel(bpy.types.Panel):
    """Encode and decode the avatar that is shown, or whole folders."""

    bl_idname = "SACHA_PT_files"
    bl_label = "Compress"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 40

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it; without an avatar there are folders to be compressed."""
        layout, chosen, setup = self.layout, context.scene.sacha, context.scene.sacha_making
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(setup, "size_by")
        if setup.size_by == "LEVEL":
            layout.prop(chosen, "level")
        elif setup.size_by == "SIZE":
            layout.prop(setup, "target_kb")
        for name in ("profile", "tune", "embed_head"):
            layout.prop(setup, name)
        layout.prop(chosen, "motion")
        shown = shown_by(context)
        if shown is not None and shown.kind == "avatar":
            row = layout.row()
            row.operator_context = "INVOKE_DEFAULT"
            row.operator("sacha.encode", text="Encode...", icon="EXPORT")
            row.operator("sacha.decode", text="Decode...", icon="IMPORT")
        column = layout.column(align=True)
        column.operator_context = "INVOKE_DEFAULT"
        column.operator("sacha.encode_folder", text="Encode Folder...")
        column.operator("sacha.decode_folder", text="Decode Folder...")


CLASSES = (SachaFilesPanel,)
