# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences: where the engine is, and how long it may take."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import FloatProperty, StringProperty

from . import engine

__all__ = ["CLASSES", "engine_python", "found", "time_limit_s"]


class SachaPreferences(bpy.types.AddonPreferences):
    """Where the engine is, and how long it may take."""

    bl_idname = __package__

    engine_python: StringProperty(
        name="Engine Python",
        description=f"The Python that has SACHA installed; where empty, the environment variable {engine.VARIABLE} names it",
        subtype="FILE_PATH",
    )
    time_limit_s: FloatProperty(
        name="Time Limit",
        description="A command of the engine that takes longer is stopped",
        subtype="TIME_ABSOLUTE",
        default=600.0,
        min=1.0,
    )
    found: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def draw(self, context: bpy.types.Context) -> None:  # noqa: ARG002  (Blender's signature)
        """Draw the fields, the button, and what the button found."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "engine_python")
        layout.prop(self, "time_limit_s")
        row = layout.row()
        row.operator("sacha.check_engine", icon="CHECKMARK")
        if self.found:
            layout.label(text=self.found, icon="INFO")


CLASSES = (SachaPreferences,)


def engine_python(context: bpy.types.Context) -> Path:
    """Give the Python that runs the engine.

    Raises:
        EngineMissingError: none is named, or what is named is no file.
    """
    named = context.preferences.addons[__package__].preferences.engine_python
    return engine.find_python(bpy.path.abspath(named) if named else "")


def found(context: bpy.types.Context) -> str:
    """Give what the last check of the engine found; empty where none was made."""
    return context.preferences.addons[__package__].preferences.found


def time_limit_s(context: bpy.types.Context) -> float:
    """Give the longest time that a command of the engine may take."""
    return context.preferences.addons[__package__].preferences.time_limit_s
