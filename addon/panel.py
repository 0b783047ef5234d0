# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's first panel: open a file; what is missing; what is running. Each part of the add-on adds its own below it."""

from __future__ import annotations

import bpy

from . import preferences, running
from .advice import advice
from .engine import EngineMissingError
from .features import draw_progress
from .telling.box import draw_problem
from .telling.lines import draw_sentence

__all__ = ["CLASSES"]


class SachaPanel(bpy.types.Panel):
    """Open a file; what is missing; what is running."""

    bl_idname = "SACHA_PT_main"
    bl_label = "SACHA"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout = self.layout
        try:
            preferences.engine_python(context)
        except EngineMissingError as missing:
            _draw_missing(layout, context, str(missing))
            return
        running_now = running.now()
        if running_now is None:
            row = layout.row(align=True)
            row.operator("sacha.open", text="Open File...", icon="FILE")
            row.operator("sacha.open_folder", text="Open Folder...", icon="FILE_FOLDER")
            layout.prop(context.scene.sacha, "head")
            layout.prop(context.scene.sacha, "masks")
        else:
            layout.label(text=running_now.work.title)
            said = running_now.job.said
            text = ", ".join(filter(None, (said.stage or "Starting", said.left)))
            draw_progress(layout, said.fraction, text)
            layout.operator("sacha.cancel", icon="CANCEL")
        draw_problem(layout, context)


def _draw_missing(layout: bpy.types.UILayout, context: bpy.types.Context, message: str) -> None:
    """Say that there is no engine, where to name one, and how to get one."""
    what, _, remedy = message.partition(": ")
    draw_sentence(layout, context, what, icon="ERROR")
    if remedy:
        draw_sentence(layout, context, remedy[:1].upper() + remedy[1:])
    draw_sentence(layout, context, advice("NoEngine"), icon="INFO")
    layout.operator("preferences.addon_show", text="Preferences", icon="PREFERENCES").module = __package__


CLASSES = (SachaPanel,)
