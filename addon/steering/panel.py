# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of the budget: regions, limit, painting, Apply, and what came of it."""

from __future__ import annotations

import bpy

from ..active import avatar_of, mesh_of
from ..telling.lines import draw_sentence

__all__ = ["CLASSES"]

ROWS = 8  # regions of the paper's scheme
WIDE, NAMES = 0.5, 0.32  # parts of a line: a region's name in the list, and in the table


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
        return avatar_of(context.object) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, avatar = self.layout, avatar_of(context.object)
        asked = avatar.data.sacha_steering
        if not len(asked.regions):
            layout.operator("sacha.list_regions")
        else:
            _draw_regions(layout, asked)
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator_menu_enum("sacha.regions_from", "kind", text="Regions From")
        row.operator("sacha.save_regions", text="", icon="FILE_TICK")
        _draw_limit(layout, context, asked)
        _draw_painting(layout, avatar, asked)
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
    column = layout.column(align=True)
    column.active = not region.locked
    column.prop(region, "lowest_share")
    column.prop(region, "highest_share")


def _draw_limit(layout: bpy.types.UILayout, context: bpy.types.Context, asked: bpy.types.PropertyGroup) -> None:
    """Draw what the budget is, and how the result is judged."""
    layout.row().prop(asked, "limit", expand=True)
    if asked.limit == "SIZE":
        layout.prop(asked, "target_kb")
    else:
        column = layout.column(align=True)
        column.prop(asked, "keep")
        column.prop(context.scene.sacha, "level")
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
        mesh = mesh_of(context)
        return mesh is not None and len(mesh.sacha_steering.outcome) > 0

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        asked = mesh_of(context).sacha_steering
        rows = list(asked.outcome)
        columns = [["Was", *(f"{row.before:,}" for row in rows)], ["Is", *(f"{row.after:,}" for row in rows)]]
        measured = any(row.known_after for row in rows)
        opened = measured and not any(row.known_before for row in rows)  # what was is what decibels are told against
        if measured:
            was = [
                "same" if opened and row.known_after else _decibels(row.psnr_before_db, row.known_before)
                for row in rows
            ]
            columns.append(["dB was", *was])
            columns.append(["dB is", *(_decibels(row.psnr_after_db, row.known_after) for row in rows)])
        _draw_columns(self.layout, ["Region", *(row.name for row in rows)], columns)
        before = f"{asked.bytes_before:,}" if asked.bytes_before else "-"
        self.layout.label(text=f"Bytes: was {before}, is {asked.bytes_after:,}")
        if opened:
            draw_sentence(self.layout, context, "Decibels are against the avatar as it was opened", icon="INFO")


def _decibels(value: float, known: bool) -> str:
    return f"{value:.1f}" if known else "-"


def _draw_columns(layout: bpy.types.UILayout, names: list[str], columns: list[list[str]]) -> None:
    """Draw a table of names and numbers, each column as wide from top to bottom."""
    split = layout.split(factor=NAMES)
    column = split.column(align=True)
    for name in names:
        column.label(text=name)
    rest = split.row(align=True)
    for texts in columns:
        column = rest.column(align=True)
        for text in texts:
            cell = column.row()
            cell.alignment = "RIGHT"
            cell.label(text=text)


CLASSES = (SACHA_UL_budget, SachaBudgetPanel, SachaOutcomePanel)
