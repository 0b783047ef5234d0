# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of regions: a list that sorts by any of its columns, and whose rows select faces."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty

from .. import problem
from .shown import SORTS, TABLES, shown_by

__all__ = ["CLASSES", "draw_table", "order_of"]

SWATCH, NAME = 0.09, 0.38  # parts of a row's width
ROWS = 8
ROOM = (0, 270, 350)  # pixels of a sidebar from which on one, two, three columns can be read
THOUSANDS = ((1e6, "M"), (1e3, "k"))


def compact(number: int) -> str:
    """Write a number in at most five characters and a sign."""
    for size, letter in THOUSANDS:
        if abs(number) >= size:
            return f"{number / size:.{1 if abs(number) < 100 * size else 0}f}{letter}"
    return str(number)


def cell(row: bpy.types.PropertyGroup, column: str) -> str:
    """Write what a row has in a column."""
    value = getattr(row, column)
    if column == "share":
        return f"{value:.1%}"
    plus = "+" if column in {"change", "bytes_change"} and value > 0 else ""
    return plus + compact(value)


def order_of(shown: bpy.types.PropertyGroup) -> list[int]:
    """Give for each region its place in the list as it is sorted; equal ones keep the scheme's order."""
    keys = [getattr(row, shown.sort_by) for row in shown.regions]
    sign = -1 if shown.sort_down else 1
    by_place = sorted(range(len(keys)), key=lambda place: (sign * keys[place], place))
    order = [0] * len(keys)
    for now, place in enumerate(by_place):
        order[place] = now
    return order


def tables_of(shown: bpy.types.PropertyGroup) -> list[str]:
    """Give the tables that all numbers are there for; the first is there always, with what it has."""
    known = shown.columns.split()
    return [name for name, _, _, columns in TABLES if name == "NOW" or all(column in known for column in columns)]


def columns_of(shown: bpy.types.PropertyGroup) -> list[str]:
    """Give the columns of the chosen table that there are numbers for."""
    chosen = shown.table if shown.table in tables_of(shown) else "NOW"
    known = shown.columns.split()
    return [column for name, _, _, columns in TABLES if name == chosen for column in columns if column in known]


def fitting_columns(shown: bpy.types.PropertyGroup, context: bpy.types.Context) -> list[str]:
    """Give those of them that the sidebar has room for; in a narrow one the column that it is sorted by, else the first."""
    columns = columns_of(shown)
    if context.region is None:
        return columns
    room = context.region.width / context.preferences.system.ui_scale
    fitting = sum(room >= least for least in ROOM)
    if fitting >= len(columns):
        return columns
    first = [shown.sort_by] if shown.sort_by in columns else columns[:1]
    shown_too = (first + [column for column in columns if column not in first])[: max(fitting, 1)]
    return [column for column in columns if column in shown_too]


class SACHA_UL_regions(bpy.types.UIList):  # noqa: N801  (Blender wants it so)
    """Regions with their colours and numbers."""

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: bpy.types.PropertyGroup,
        item: bpy.types.PropertyGroup,
        icon: int,  # noqa: ARG002
        active_data: bpy.types.PropertyGroup,  # noqa: ARG002
        active_property: str,  # noqa: ARG002
        index: int = 0,  # noqa: ARG002
        flt_flag: int = 0,  # noqa: ARG002
    ) -> None:
        """Draw one row."""
        split = layout.split(factor=SWATCH)
        split.prop(item, "colour", text="")
        rest = split.split(factor=NAME)
        rest.label(text=item.name)
        numbers = rest.row()
        for column in fitting_columns(data, context):
            one = numbers.row()
            one.alignment = "RIGHT"
            one.label(text=cell(item, column))

    def filter_items(
        self,
        context: bpy.types.Context,  # noqa: ARG002  (Blender's signature)
        data: bpy.types.PropertyGroup,
        property_name: str,  # noqa: ARG002
    ) -> tuple[list[int], list[int]]:
        """Sort by the chosen column, and keep the rows whose names have what is typed into the filter."""
        typed = self.filter_name.lower()
        flags = [self.bitflag_filter_item if typed in row.name.lower() else 0 for row in data.regions]
        return flags, order_of(data)


class SachaSortRegions(bpy.types.Operator):
    """Sort the table of regions by a column; the same column again turns the order round."""

    bl_idname = "sacha.sort_regions"
    bl_label = "Sort Regions"
    bl_description = "Sort the table by this column; once more turns the order round"
    bl_options = {"INTERNAL"}  # noqa: RUF012  (Blender reads it as it is)

    by: EnumProperty(name="By", items=[(name, *rest) for name, *rest in SORTS])

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a table."""
        shown = shown_by(context)
        return shown is not None and len(shown.regions) > 0

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Sort: numbers with the largest first, regions in their order."""
        shown = shown_by(context)
        if self.by not in shown.columns.split():
            return problem.tell(self, f"Nothing is known of {self.by} here")
        shown.sort_down = not shown.sort_down if shown.sort_by == self.by else self.by != "place"
        shown.sort_by = self.by
        return {"FINISHED"}


def draw_table(layout: bpy.types.UILayout, context: bpy.types.Context, shown: bpy.types.PropertyGroup) -> None:
    """Draw headings that sort, the list, and all numbers of the chosen row."""
    titles = {name: title for name, title, _ in SORTS}
    if len(tables_of(shown)) > 1:
        choice = layout.row(align=True)
        for table in tables_of(shown):
            choice.prop_enum(shown, "table", table)
    heading = layout.split(factor=SWATCH + (1 - SWATCH) * NAME, align=True)
    _sort_button(heading, shown, "place", titles["place"])
    columns = heading.row(align=True)
    for column in fitting_columns(shown, context):
        _sort_button(columns, shown, column, titles[column])
    layout.template_list("SACHA_UL_regions", "", shown, "regions", shown, "active_region", rows=ROWS, maxrows=ROWS)
    if 0 <= shown.active_region < len(shown.regions):
        _draw_row(layout, shown, shown.regions[shown.active_region])


def _sort_button(layout: bpy.types.UILayout, shown: bpy.types.PropertyGroup, column: str, title: str) -> None:
    mine = shown.sort_by == column
    arrow = ("SORT_DESC" if shown.sort_down else "SORT_ASC") if mine else "NONE"
    layout.operator("sacha.sort_regions", text=title, icon=arrow, emboss=False).by = column


def _draw_row(layout: bpy.types.UILayout, shown: bpy.types.PropertyGroup, row: bpy.types.PropertyGroup) -> None:
    """Tell all of one region, and offer to select its faces."""
    box = layout.box()
    heading = box.row()
    heading.label(text=row.name)
    heading.operator("sacha.select_region", text="Select", icon="RESTRICT_SELECT_OFF").region = row.name
    known = shown.columns.split()
    column = box.column(align=True)
    column.label(text=f"{row.triangles:,} triangles, {row.area_cm2:,.1f} cm²")
    if "n_bytes" in known and row.gaussians:
        column.label(text=f"{row.n_bytes:,} bytes, {row.bytes_each:.2f} for each Gaussian")
    if "before" in known:
        column.label(text=f"{row.gaussians:,} ({row.share:.1%}), {row.change:+,}")
        column.label(text=f"{shown.before_name}: {row.before:,} ({row.before_share:.1%})")
    if "bytes_change" in known:
        column.label(text=f"{shown.before_name}: {row.before_bytes:,} bytes, now {row.bytes_change:+,}")


CLASSES = (SACHA_UL_regions, SachaSortRegions)
