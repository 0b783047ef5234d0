# SPDX-License-Identifier: GPL-3.0-or-later
"""Of which head an object holds the splats, and how it shows them: kept with the object in the .blend."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import splat_nodes

__all__ = ["CLASSES", "attach", "detach"]


def _changed(settings: SachaSplats, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    """Hand the settings on to the nodes that show the splats."""
    splat_nodes.apply(settings.id_data)


class SachaSplats(bpy.types.PropertyGroup):
    """Of which head an object holds the splats, and how it shows them."""

    head: PointerProperty(
        name="Head", description="The head that carries these splats", type=bpy.types.Object, update=_changed
    )
    source: StringProperty(name="Source", description="The avatar that these splats are from", subtype="FILE_PATH")
    n_faces: IntProperty(name="Triangles", description="Triangles that the head must have", min=0)
    follow: BoolProperty(
        name="Follow the Head",
        description="Let splats move with the triangles that carry them; otherwise they stay as they were brought here",
        default=True,
        update=_changed,
    )
    size: FloatProperty(
        name="Size",
        description="Radius of ellipsoids, in standard deviations of their Gaussians",
        default=1.5,
        min=0.1,
        max=4.0,
        update=_changed,
    )
    least_opacity: FloatProperty(
        name="Least Opacity",
        description="Fainter splats are left out",
        default=0.2,
        min=0.0,
        max=1.0,
        update=_changed,
    )
    soft: BoolProperty(
        name="Soft",
        description="Instances that fade out as Gaussians do, for rendered views; otherwise solid ellipsoids, which solid views colour",
        update=_changed,
    )


CLASSES = (SachaSplats,)


def attach() -> None:
    """Give objects their settings."""
    bpy.types.Object.sacha_splats = PointerProperty(type=SachaSplats)


def detach() -> None:
    """Take them away again."""
    del bpy.types.Object.sacha_splats
