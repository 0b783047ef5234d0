# SPDX-License-Identifier: GPL-3.0-or-later
"""What not every Blender has: asked of the Blender that runs, never told from its version."""

from __future__ import annotations

import bpy

__all__ = ["DROPS_FILES", "corner_coordinates", "counts_corners", "draw_progress", "key_points", "session_number"]

DROPS_FILES = hasattr(bpy.types, "FileHandler")  # files dropped on a window: since 4.1


def counts_corners() -> bool:
    """Tell whether polygons keep how many corners they have: until 3.5; later that follows from where the next one starts."""
    return not bpy.types.MeshPolygon.bl_rna.properties["loop_total"].is_readonly


def corner_coordinates(layer: bpy.types.MeshUVLoopLayer) -> tuple[bpy.types.bpy_prop_collection, str]:
    """Give where the texture coordinates of a mesh's corners lie, and under which name: a field of their own since 3.5."""
    return (layer.uv, "vector") if hasattr(layer, "uv") else (layer.data, "uv")


def key_points(key: bpy.types.ShapeKey) -> bpy.types.bpy_prop_collection:
    """Give the points of a shape key; since 3.6 they can be had without asking each for its type."""
    return key.points if hasattr(key, "points") else key.data


def session_number(block: bpy.types.ID) -> int | None:
    """Give what tells a data block from all others while Blender runs, whatever it is called; None before 4.1, where scripts cannot ask."""
    return getattr(block, "session_uid", None)


def draw_progress(layout: bpy.types.UILayout, factor: float, text: str) -> None:
    """Draw a bar; before 4.0, words."""
    if "progress" in bpy.types.UILayout.bl_rna.functions:
        layout.progress(factor=factor, text=text)
    else:
        layout.label(text=f"{factor:.0%}  {text}")
