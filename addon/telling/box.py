# SPDX-License-Identifier: GPL-3.0-or-later
"""The last problem as a box in a panel."""

from __future__ import annotations

import bpy

from .. import problem
from .lines import draw_sentence

__all__ = ["draw_problem"]


def draw_problem(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what went wrong last and what to do about it; nothing where all is well."""
    wrong = problem.last()
    if wrong is None:
        return
    box = layout.box()
    draw_sentence(box, context, wrong.message, icon="ERROR")
    if wrong.advice:
        draw_sentence(box, context, wrong.advice, icon="INFO")
    buttons = box.column(align=True)
    buttons.operator("sacha.dismiss", icon="X")
    buttons.operator("sacha.copy_diagnostics", icon="COPYDOWN")
