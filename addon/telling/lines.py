# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences in panels: Blender cuts a label that is too long, so that words are set line by line."""

from __future__ import annotations

import textwrap

import bpy

__all__ = ["draw_sentence"]

PIXELS_A_CHARACTER = 6.2  # of Blender's interface font at size 1, on average
MARGIN_PIXELS = 60.0  # what a panel takes at both sides, with an icon
FEWEST, WHERE_UNKNOWN = 20, 40  # characters a line


def draw_sentence(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """Draw a sentence over as many lines as the panel's width asks for.

    Args:
        layout: where.
        context: of the panel; its region says how wide it is.
        text: words.
        icon: beside the first line.
    """
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, _characters(context), break_on_hyphens=False)):
        column.label(text=line, icon=("BLANK1" if number else icon) if icon != "NONE" else "NONE")


def _characters(context: bpy.types.Context) -> int:
    if context.region is None:
        return WHERE_UNKNOWN
    scale = context.preferences.system.ui_scale
    return max(FEWEST, int((context.region.width / scale - MARGIN_PIXELS) / PIXELS_A_CHARACTER))
