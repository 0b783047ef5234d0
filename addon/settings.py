# SPDX-License-Identifier: GPL-3.0-or-later
"""What the commands use, kept with the scene in the .blend."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty, PointerProperty, StringProperty

__all__ = ["CLASSES", "attach", "detach"]


class SachaSettings(bpy.types.PropertyGroup):
    """What the commands use, kept with the scene."""

    head: StringProperty(
        name="Head",
        description="Head model that avatars are bound to; may be empty for files that hold it, and for heads used before",
        subtype="FILE_PATH",
    )
    masks: StringProperty(
        name="Masks",
        description="Vertex masks (FLAME_masks.npz or .pkl), which tell the regions of a head apart that brings none; may be empty",
        subtype="FILE_PATH",
    )
    motion: StringProperty(
        name="Motion", description="Motion to put into the .sacha file (.npz); may be empty", subtype="FILE_PATH"
    )
    level: IntProperty(
        name="Level", description="1 gives the smallest file, 4 the best quality", default=2, min=1, max=4
    )


CLASSES = (SachaSettings,)


def attach() -> None:
    """Give scenes their settings."""
    bpy.types.Scene.sacha = PointerProperty(type=SachaSettings)


def detach() -> None:
    """Take them away again."""
    del bpy.types.Scene.sacha
