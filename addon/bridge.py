# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays into Blender's meshes and back: the only file that knows Blender's axes."""

from __future__ import annotations

import bpy
import numpy as np

from .features import corner_coordinates, counts_corners

__all__ = [
    "corner_colours",
    "face_integers",
    "new_mesh",
    "show_colours",
    "texture_coordinates",
    "to_blender",
    "to_engine",
]

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
    mesh.validate()
    kept = len(mesh.polygons)
    if kept != len(faces):
        bpy.data.meshes.remove(mesh)
        raise ValueError(
            f"Blender keeps only {kept} of the {len(faces)} triangles: some use a vertex twice or lie on each other"
        )
    return mesh


def face_integers(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    """Store one whole number a triangle as a FACE attribute; (f,) values."""
    attribute = _new_attribute(mesh, name, "INT", "FACE", len(values))
    attribute.data.foreach_set("value", np.ascontiguousarray(values, np.int32))


def corner_colours(mesh: bpy.types.Mesh, name: str, colours: np.ndarray) -> None:
    """Store one colour a triangle at its three corners, so that its edges stay hard; (f, 4) linear RGBA."""
    attribute = _new_attribute(mesh, name, "FLOAT_COLOR", "CORNER", 3 * len(colours))
    attribute.data.foreach_set("color", np.repeat(colours.astype(np.float32), 3, axis=0).ravel())


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


def _new_attribute(mesh: bpy.types.Mesh, name: str, kind: str, domain: str, length: int) -> bpy.types.Attribute:
    """Make an attribute, and make sure that it is there and as long as it must be."""
    if len(name.encode()) > LONGEST_NAME:
        raise ValueError(f"the attribute name {name!r} is longer than Blender's {LONGEST_NAME} bytes")
    attribute = mesh.attributes.new(name, kind, domain)
    if attribute is None or len(attribute.data) != length:
        raise ValueError(f"Blender made no {domain} attribute {name!r} of {length} values")
    return attribute
