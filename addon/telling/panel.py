# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's last panel: help."""

from __future__ import annotations

import bpy

from ..preferences import found
from .lines import draw_sentence

__all__ = ["CLASSES"]


class SachaHelpPanel(bpy.types.Panel):
    """Which engine there is, and diagnostics to copy."""

    bl_idname = "SACHA_PT_help"
    bl_label = "Help"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 90
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it as it is)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.layout
        draw_sentence(layout, context, found(context) or "The engine has not been checked")
        column = layout.column(align=True)
        column.operator("sacha.check_engine", icon="CHECKMARK")
        column.operator("sacha.copy_diagnostics", icon="COPYDOWN")
        column.operator("preferences.addon_show", text="Preferences", icon="PREFERENCES").module = ADDON


ADDON = __package__.rpartition(".")[0]

CLASSES = (SachaHelpPanel,)
