# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of what a mesh shows: facts, the view, its legend, the table of regions."""

from __future__ import annotations

import bpy

from ..telling.lines import draw_sentence
from . import painting
from .legend import draw_legend, draw_line
from .shown import edited, shown_by
from .table import draw_table

__all__ = ["CLASSES"]


class SachaShownPanel(bpy.types.Panel):
    """What the active mesh shows, and the legend of it."""

    bl_idname = "SACHA_PT_shown"
    bl_label = "Gaussians"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 10

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for meshes that were opened here."""
        return shown_by(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, shown = self.layout, shown_by(context)
        for fact in shown.facts:
            draw_sentence(layout, context, fact.name)
        for complaint in (edited(shown.id_data), painting.complaint(shown.id_data)):
            if complaint:
                draw_sentence(layout, context, complaint, "ERROR")
        if not shown.views:
            draw_sentence(layout, context, "Its regions are not known: name its head model and open it again", "INFO")
        else:
            _draw_view(layout, shown)
        for line in shown.absent:
            draw_sentence(layout, context, line.name, "INFO")
        if shown.kind == "avatar":
            if "threshold" not in shown.views:
                layout.operator("sacha.measure", icon="DRIVER_DISTANCE")
            row = layout.row(align=True)
            row.operator("sacha.compare", icon="UV_SYNC_SELECT")
            row.operator("sacha.refresh", icon="FILE_REFRESH")


class SachaRegionsPanel(bpy.types.Panel):
    """The table of the active mesh's regions."""

    bl_idname = "SACHA_PT_regions"
    bl_label = "Regions"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 11

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only for meshes with regions."""
        shown = shown_by(context)
        return shown is not None and len(shown.regions) > 0

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        draw_table(self.layout, context, shown_by(context))


def _draw_view(layout: bpy.types.UILayout, shown: bpy.types.PropertyGroup) -> None:
    """Draw the choice of a view and its legend: round numbers of triangles, or the number of each region."""
    if len(shown.views) > 1:
        layout.prop(shown, "view", text="")
    view = shown.shown_view()
    if view is None:
        return
    has_both = view.name != "region" and len(view.by_region) > 0
    if has_both:
        layout.row().prop(shown, "by", expand=True)
    column = layout.column(align=True)
    if has_both and shown.by == "REGION":
        for region, number in zip(shown.regions, view.by_region, strict=False):
            draw_line(column, number, region.name, f"{number.name} {view.unit}".strip())
        return
    draw_legend(column, view.legend, view.unit)


CLASSES = (SachaShownPanel, SachaRegionsPanel)
