# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays into Blender's meshes and back: the only file that knows Blender's axes."""

from __future__ import annotations

import bpy
import numpy as np

from .features import corner_coordinates, counts_corners

__all__ = [
    "corner_colours",
    "face_numbers",
    "new_mesh",
    "read_face_integers",
    "select_faces",
    "show_colours",
    "texture_coordinates",
    "to_blender",
    "to_engine",
]

EDGE_SELECTION = ".select_edge"
LONGEST_NAME = 63  # bytes; an attribute with a longer name is silently not made


def to_blender(points: np.ndarray) -> np.ndarray:
    """Turn (n, 3) points from the engine's axes (y up, z forward) to Blender's (z up, -y forward). Both are in metres."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1).astype(np.float32)


def to_engine(points: np.ndarray) -> np.ndarray:
    """Undo `to_blender`."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1).astype(np.float32)


def new_mesh(name: str, vertices: np.ndarray, faces: np.ndarray) -> bpy.types.Mesh:
    """Make a mesh of triangles whose polygons are `faces` in the same order.

    Args:
        name: of the data block.
        vertices: (v, 3) in the engine's axes, metres.
        faces: (f, 3) vertex indices.

    Returns:
        The mesh, in no object yet.

    Raises:
        ValueError: Blender holds some of the triangles for impossible, so that attributes would not line up; the mesh is gone again.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", to_blender(vertices).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    if counts_corners():
        mesh.polygons.foreach_set("loop_total", np.full(len(faces), 3, np.int32))
    mesh.update(calc_edges=True)
    _mend_edge_selection(mesh)
    mesh.validate()
    kept = len(mesh.polygons)
    if kept != len(faces):
        bpy.data.meshes.remove(mesh)
        raise ValueError(
            f"Blender keeps only {kept} of the {len(faces)} triangles: some use a vertex twice or lie on each other"
        )
    return mesh


def face_numbers(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    """Store one number a face as a FACE attribute, INT for whole numbers and else FLOAT, in place of what it held; (f,) values."""
    kind, number = ("INT", np.int32) if np.issubdtype(values.dtype, np.integer) else ("FLOAT", np.float32)
    attribute = _attribute(mesh, name, kind, "FACE", len(values))
    attribute.data.foreach_set("value", np.ascontiguousarray(values, number))


def read_face_integers(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    """Give the (f,) whole numbers of a FACE attribute."""
    values = np.empty(len(mesh.polygons), np.int32)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def corner_colours(mesh: bpy.types.Mesh, name: str, colours: np.ndarray) -> None:
    """Store one colour a face at all of its corners, so that its edges stay hard, in place of what was there; (f, 4) linear RGBA."""
    corners = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", corners)
    attribute = _attribute(mesh, name, "FLOAT_COLOR", "CORNER", len(mesh.loops))
    attribute.data.foreach_set("color", np.repeat(colours.astype(np.float32), corners, axis=0).ravel())


def select_faces(mesh: bpy.types.Mesh, chosen: np.ndarray, *, extend: bool) -> None:
    """Select faces with their edges and vertices, alone or besides those that are selected; (f,) chosen."""
    _mend_edge_selection(mesh)
    corners = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", corners)
    of_corner = np.repeat(chosen, corners)
    for elements, index in ((mesh.vertices, "vertex_index"), (mesh.edges, "edge_index"), (mesh.polygons, "")):
        selected = np.zeros(len(elements), bool)
        if extend:
            elements.foreach_get("select", selected)
        if index:
            of_loop = np.empty(len(mesh.loops), np.int32)
            mesh.loops.foreach_get(index, of_loop)
            selected[of_loop[of_corner]] = True
        else:
            selected |= chosen
        elements.foreach_set("select", selected)
    mesh.update()


def texture_coordinates(mesh: bpy.types.Mesh, name: str, uv: np.ndarray) -> None:
    """Store (f, 3, 2) texture coordinates of each triangle's corners as a UV map."""
    layer = mesh.uv_layers.new(name=name)
    coordinates, name_there = corner_coordinates(layer)
    coordinates.foreach_set(name_there, np.ascontiguousarray(uv, np.float32).ravel())


def show_colours(mesh: bpy.types.Mesh, name: str) -> None:
    """Make one colour attribute the one that viewports and renders show."""
    colours = mesh.color_attributes
    colours.active_color = colours[name]
    colours.render_color_index = colours.find(name)


def _mend_edge_selection(mesh: bpy.types.Mesh) -> None:
    """Remove a selection of edges that is none: Blender 5.0 makes one of pairs of integers beside new edges, and crashes when it is set."""
    selection = mesh.attributes.get(EDGE_SELECTION)
    if selection is not None and selection.data_type != "BOOLEAN":
        mesh.attributes.remove(selection)


def _attribute(mesh: bpy.types.Mesh, name: str, kind: str, domain: str, length: int) -> bpy.types.Attribute:
    """Find or make an attribute, and make sure that it is what it must be."""
    if len(name.encode()) > LONGEST_NAME:
        raise ValueError(f"the attribute name {name!r} is longer than Blender's {LONGEST_NAME} bytes")
    attribute = mesh.attributes.get(name)
    if attribute is None:
        attribute = mesh.attributes.new(name, kind, domain)
    elif (attribute.data_type, attribute.domain) != (kind, domain):
        raise ValueError(
            f"{mesh.name} has an attribute {name!r} of another kind ({attribute.domain} {attribute.data_type}): rename it first"
        )
    if attribute is None or len(attribute.data) != length:
        raise ValueError(f"Blender made no {domain} attribute {name!r} of {length} values")
    return attribute
