# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of the view that is shown: rows of a palette, copied to the corners of triangles.

Only the shown view has a colour attribute. Each view keeps a row number for each face, so that a .blend holds four bytes a face and view
rather than 48, and a mesh that is edited keeps its colours.
"""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from .. import bridge

__all__ = ["COLOURS", "PALETTES", "complaint", "level_attribute", "paint", "painted_by", "palette_of"]

COLOURS = "sacha_colour"  # the colour attribute
PALETTES = "sacha_palettes"  # custom property of the mesh


def level_attribute(view: str) -> str:
    """Name of the attribute that holds each face's row in the palette of a view."""
    return f"{view}_level"


def palette_of(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """Give a palette as (p, 4) float32 linear RGBA; one black row where the mesh has lost it."""
    stored = mesh.get(PALETTES, {})
    rows = np.array(stored.get(name, ()), np.float32).reshape(-1, 4)
    return rows if len(rows) else np.array([[0.0, 0.0, 0.0, 1.0]], np.float32)


def painted_by(mesh: bpy.types.Mesh) -> str:
    """Name of the attribute that the shown view gets its colours by; empty where nothing is shown."""
    view = mesh.sacha.shown_view()
    if view is None:
        return ""
    return "region" if mesh.sacha.by == "REGION" and len(view.by_region) > 0 else level_attribute(view.name)


def complaint(mesh: bpy.types.Mesh) -> str:
    """Say that the colours are not those of the view that is chosen, because somebody removed its numbers; empty where all is well."""
    attribute = painted_by(mesh)
    if not attribute or attribute in mesh.attributes:
        return ""
    return f"The mesh has lost its attribute {attribute}, so that its colours are of another view: Read Again brings it back"


def paint(mesh: bpy.types.Mesh) -> None:
    """Show the view that the mesh has chosen; leave the colours alone where its numbers are gone, which `complaint` tells."""
    shown = mesh.sacha
    view = shown.shown_view()
    if view is None:
        return
    attribute = painted_by(mesh)
    by_region = attribute == "region"
    palette = palette_of(mesh, view.palette)
    if by_region:
        levels = np.array([number.level for number in view.by_region], np.int32)
        palette = palette[np.clip(levels, 0, len(palette) - 1)]
    if mesh.is_editmode:
        _paint_in_edit_mode(mesh, attribute, palette)
    elif attribute in mesh.attributes:
        rows = bridge.read_face_integers(mesh, attribute)
        bridge.corner_colours(mesh, COLOURS, palette[np.clip(rows, 0, len(palette) - 1)])
        bridge.show_colours(mesh, COLOURS)


def _paint_in_edit_mode(mesh: bpy.types.Mesh, attribute: str, palette: np.ndarray) -> None:
    """Do the same where Edit Mode holds the mesh's data, face by face."""
    edited = bmesh.from_edit_mesh(mesh)
    rows, colours = edited.faces.layers.int.get(attribute), edited.loops.layers.float_color.get(COLOURS)
    if rows is None or colours is None:
        return
    of_row, last = [tuple(colour) for colour in palette.tolist()], len(palette) - 1
    for face in edited.faces:
        colour = of_row[min(max(face[rows], 0), last)]
        for corner in face.loops:
            corner[colours] = colour
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
