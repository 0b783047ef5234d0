# SPDX-License-Identifier: GPL-3.0-or-later
"""Legends in panels: swatches and what they stand for."""

from __future__ import annotations

import bpy

__all__ = ["draw_legend", "draw_line"]

SWATCH = 0.12  # part of a legend line's width


def draw_legend(column: bpy.types.UILayout, lines: bpy.types.bpy_prop_collection, unit: str = "") -> None:
    """Draw a legend."""
    for line in lines:
        draw_line(column, line, f"{line.name} {unit}".strip())


def draw_line(column: bpy.types.UILayout, line: bpy.types.PropertyGroup, label: str, number: str = "") -> None:
    """Draw one line of a legend: its colour, its name, its number."""
    split = column.split(factor=SWATCH)
    split.prop(line, "colour", text="")
    rest = split.row()
    rest.label(text=label)
    if number:
        cell = rest.row()
        cell.alignment = "RIGHT"
        cell.label(text=number)
