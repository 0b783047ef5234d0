# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar of the 3D view: open a file, see its regions and counts, encode and decode it."""

from __future__ import annotations

import bpy

from . import preferences, running
from .engine import EngineMissingError

__all__ = ["CLASSES"]

SWATCH, NUMBER = 0.12, 0.5  # parts of a legend line's width


def shown_by(context: bpy.types.Context) -> bpy.types.PropertyGroup | None:
    """Give what the active mesh shows, or None where it is not ours."""
    mesh = context.object.data if context.object is not None and context.object.type == "MESH" else None
    return mesh.sacha if mesh is not None and mesh.sacha.kind else None


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
            _draw_missing(layout, str(missing))
            return
        running_now = running.now()
        if running_now is None:
            layout.operator("sacha.open", text="Open File...", icon="FILE_FOLDER")
            layout.prop(context.scene.sacha, "head")
            layout.prop(context.scene.sacha, "masks")
        else:
            layout.label(text=running_now.work.title)
            layout.progress(factor=running_now.job.fraction, text=running_now.job.stage or "Starting")
            layout.operator("sacha.cancel", icon="CANCEL")


class SachaShownPanel(bpy.types.Panel):
    """What the active mesh shows, and the legend of it."""

    bl_idname = "SACHA_PT_shown"
    bl_label = "Gaussians"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_parent_id = "SACHA_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for meshes that were opened here."""
        return shown_by(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, shown = self.layout, shown_by(context)
        for fact in shown.facts:
            layout.label(text=fact.name)
        if not shown.legend:
            layout.label(text="Its regions are not known: name its head model and open it again", icon="INFO")
            return
        if len({line.view for line in shown.legend}) > 1:
            layout.row().prop(shown, "view", expand=True)
        lines = [line for line in shown.legend if line.view == shown.view.lower()]
        column = layout.column(align=True)
        if shown.view == "REGION":
            _legend_row(column, None, "Region", "Triangles", "Gaussians")
        for line in lines:
            numbers = (f"{line.triangles:,}", f"{line.gaussians:,}") if shown.view == "REGION" else ()
            _legend_row(column, line, line.name, *numbers)


class SachaFilesPanel(bpy.types.Panel):
    """Encode and decode the avatar that is shown."""

    bl_idname = "SACHA_PT_files"
    bl_label = "Compress"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_parent_id = "SACHA_PT_main"

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


def _legend_row(column: bpy.types.UILayout, line: bpy.types.PropertyGroup | None, label: str, *numbers: str) -> None:
    """Draw one line of a legend: its colour, its name, its numbers; without a colour it is the heading."""
    split = column.split(factor=SWATCH)
    if line is None:
        split.label(text="")
    else:
        swatch = split.row()
        swatch.enabled = False
        swatch.prop(line, "colour", text="")
    rest = split.row()
    rest.label(text=label)
    for number in numbers:
        cell = rest.row()
        cell.alignment = "RIGHT"
        cell.label(text=number)


def _draw_missing(layout: bpy.types.UILayout, message: str) -> None:
    """Say that there is no engine and where to name one."""
    what, _, remedy = message.partition(": ")
    layout.label(text=what, icon="ERROR")
    if remedy:
        layout.label(text=remedy)
    layout.operator("preferences.addon_show", text="Preferences", icon="PREFERENCES").module = __package__


CLASSES = (SachaPanel, SachaShownPanel, SachaFilesPanel)
