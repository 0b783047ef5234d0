# SPDX-License-Identifier: GPL-3.0-or-later
"""What the add-on keeps in a .blend: on a mesh what it shows, on a scene what the next commands shall use."""

from __future__ import annotations

import bpy
from bpy.props import (
    CollectionProperty,
    EnumProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import bridge

__all__ = ["CLASSES", "attach", "colour_attribute", "detach"]


def colour_attribute(view: str) -> str:
    """Name of the colour attribute that shows a number attribute."""
    return f"{view}_colour"


def _view_changed(shown: SachaShown, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    """Show the colours of the view that was chosen."""
    name = colour_attribute(shown.view.lower())
    if name in shown.id_data.color_attributes:
        bridge.show_colours(shown.id_data, name)


class SachaLegendLine(bpy.types.PropertyGroup):
    """One line of a legend; `name` is its label."""

    view: StringProperty()
    colour: FloatVectorProperty(subtype="COLOR", size=3, min=0.0, max=1.0)
    triangles: IntProperty(min=0)
    gaussians: IntProperty(min=0)


class SachaFact(bpy.types.PropertyGroup):
    """One thing worth knowing of what is shown; `name` says it."""


class SachaShown(bpy.types.PropertyGroup):
    """What a mesh shows, kept with the mesh."""

    source: StringProperty(name="Source", description="The file that this was opened from", subtype="FILE_PATH")
    kind: StringProperty(name="Kind")
    head: StringProperty(name="Head", description="The head model that it is bound to")
    facts: CollectionProperty(type=SachaFact)
    legend: CollectionProperty(type=SachaLegendLine)
    view: EnumProperty(
        name="View",
        description="What the colours of the triangles say",
        items=[
            ("REGION", "Region", "The region that each triangle belongs to"),
            ("COUNT", "Count", "How many Gaussians each triangle carries"),
        ],
        update=_view_changed,
    )


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


CLASSES = (SachaLegendLine, SachaFact, SachaShown, SachaSettings)


def attach() -> None:
    """Give meshes and scenes their settings."""
    bpy.types.Mesh.sacha = PointerProperty(type=SachaShown)
    bpy.types.Scene.sacha = PointerProperty(type=SachaSettings)


def detach() -> None:
    """Take them away again."""
    del bpy.types.Scene.sacha
    del bpy.types.Mesh.sacha
