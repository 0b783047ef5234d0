# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of the budget: regions, limit, painting, Apply, and what came of it."""

from __future__ import annotations

import bpy

from ..seeing.shown import shown_by

__all__ = ["CLASSES"]

ROWS = 8  # regions of the paper's scheme
WIDE, NARROW = 0.45, 0.5  # parts of a line


class SACHA_UL_budget(bpy.types.UIList):  # noqa: N801  (Blender wants such names)
    """Regions with their weights and locks."""

    bl_idname = "SACHA_UL_budget"

    def draw_item(
        self,
        context: bpy.types.Context,  # noqa: ARG002  (Blender's signature)
        layout: bpy.types.UILayout,
        data: bpy.types.PropertyGroup,  # noqa: ARG002
        item: bpy.types.PropertyGroup,
        icon: int,  # noqa: ARG002
        active_data: bpy.types.PropertyGroup,  # noqa: ARG002
        active_property: str,  # noqa: ARG002
    ) -> None:
        """Draw one region."""
        split = layout.split(factor=WIDE)
        bounded = item.lowest_share > 0 or item.highest_share < 100
        split.label(text=item.name, icon="RESTRICT_SELECT_OFF" if bounded else "BLANK1")
        row = split.row(align=True)
        weight = row.row(align=True)
        weight.active = not item.locked
        weight.prop(item, "weight", text="")
        row.prop(item, "locked", text="", icon="LOCKED" if item.locked else "UNLOCKED")


class SachaBudgetPanel(bpy.types.Panel):
    """Who may keep how many Gaussians."""

    bl_idname = "SACHA_PT_budget"
    bl_label = "Budget"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 20

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only an avatar has Gaussians to spend."""
        shown = shown_by(context)
        return shown is not None and shown.kind == "avatar"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, mesh = self.layout, context.object.data
        asked = mesh.sacha_steering
        if not len(asked.regions):
            layout.operator("sacha.list_regions")
        else:
            _draw_regions(layout, asked)
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator_menu_enum("sacha.regions_from", "kind", text="Regions From")
        row.operator("sacha.save_regions", text="", icon="FILE_TICK")
        _draw_limit(layout, context, asked)
        _draw_painting(layout, context.object, asked)
        row = layout.row()
        row.scale_y = 1.4
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("sacha.apply_budget", icon="CHECKMARK")


def _draw_regions(layout: bpy.types.UILayout, asked: bpy.types.PropertyGroup) -> None:
    """Draw the list, and the shares of the region that is chosen in it."""
    layout.template_list("SACHA_UL_budget", "", asked, "regions", asked, "active", rows=ROWS)
    if not 0 <= asked.active < len(asked.regions):
        return
    region = asked.regions[asked.active]
    row = layout.row(align=True)
    row.active = not region.locked
    row.prop(region, "lowest_share")
    row.prop(region, "highest_share")


def _draw_limit(layout: bpy.types.UILayout, context: bpy.types.Context, asked: bpy.types.PropertyGroup) -> None:
    """Draw what the budget is, and how the result is judged."""
    layout.row().prop(asked, "limit", expand=True)
    if asked.limit == "SIZE":
        layout.prop(asked, "target_kb")
    else:
        row = layout.row(align=True)
        row.prop(asked, "keep")
        row.prop(context.scene.sacha, "level")
    layout.prop(asked, "measure")
    layout.prop(asked, "dataset")


def _draw_painting(layout: bpy.types.UILayout, shown: bpy.types.Object, asked: bpy.types.PropertyGroup) -> None:
    """Draw what is painted where."""
    layout.prop(asked, "paint_by")
    if asked.paint_by == "NOTHING":
        return
    if asked.paint_by == "GROUP":
        layout.prop_search(asked, "paint", shown, "vertex_groups", text="Group")
    else:
        layout.prop_search(asked, "paint", shown.data, "color_attributes", text="Colours")
    layout.prop(asked, "paint_strength")


class SachaOutcomePanel(bpy.types.Panel):
    """What the last Apply changed."""

    bl_idname = "SACHA_PT_outcome"
    bl_label = "Outcome"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_budget"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only after an Apply."""
        shown = shown_by(context)
        return shown is not None and len(context.object.data.sacha_steering.outcome) > 0

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        asked = context.object.data.sacha_steering
        pictures = any(row.known_before or row.known_after for row in asked.outcome)
        column = self.layout.column(align=True)
        _draw_line(column, "Region", "Before", "After", *(("dB before", "dB after") if pictures else ()))
        for row in asked.outcome:
            decibels = (
                f"{value:.1f}" if known else "-"
                for known, value in ((row.known_before, row.psnr_before_db), (row.known_after, row.psnr_after_db))
            )
            _draw_line(column, row.name, f"{row.before:,}", f"{row.after:,}", *(decibels if pictures else ()))
        before = f"{asked.bytes_before:,}" if asked.bytes_before else "-"
        _draw_line(column, "Bytes", before, f"{asked.bytes_after:,}", *(("", "") if pictures else ()))


def _draw_line(column: bpy.types.UILayout, name: str, *values: str) -> None:
    """Draw one line of the table."""
    split = column.split(factor=1 - NARROW if len(values) < 3 else 0.3)
    split.label(text=name)
    row = split.row()
    for value in values:
        cell = row.row()
        cell.alignment = "RIGHT"
        cell.label(text=value)


CLASSES = (SACHA_UL_budget, SachaBudgetPanel, SachaOutcomePanel)
