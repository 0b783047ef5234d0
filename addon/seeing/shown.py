# SPDX-License-Identifier: GPL-3.0-or-later
"""What a mesh shows, kept with it in the .blend."""

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

from .. import bridge

__all__ = ["CLASSES", "attach", "colour_attribute", "detach", "shown_by"]


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


CLASSES = (SachaLegendLine, SachaFact, SachaShown)


def attach() -> None:
    """Give meshes what they show."""
    bpy.types.Mesh.sacha = PointerProperty(type=SachaShown)


def detach() -> None:
    """Take it away again."""
    del bpy.types.Mesh.sacha


def shown_by(context: bpy.types.Context) -> bpy.types.PropertyGroup | None:
    """Give what the active mesh shows, or None where it is not ours."""
    mesh = context.object.data if context.object is not None and context.object.type == "MESH" else None
    return mesh.sacha if mesh is not None and mesh.sacha.kind else None
