# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of what a mesh shows: facts, the view, its legend."""

from __future__ import annotations

import bpy

from .shown import shown_by

__all__ = ["CLASSES"]

SWATCH = 0.12  # part of a legend line's width


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


CLASSES = (SachaShownPanel,)
