# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user painted on a mesh, as an array for the engine."""

from __future__ import annotations

import bpy
import numpy as np

__all__ = ["painted"]


def painted(shown: bpy.types.Object) -> np.ndarray | None:
    """Give what was painted where the budget says; None where it says nothing.

    Returns:
        (v,) weights of a vertex group, 0 where a vertex is not in it; or (v, 4) or (3 f, 4) linear colours of vertices or corners.

    Raises:
        ValueError: there is no such vertex group or colour attribute.
    """
    asked = shown.data.sacha_steering
    if asked.paint_by == "GROUP":
        return _weights(shown, asked.paint)
    if asked.paint_by == "COLOUR":
        return _colours(shown.data, asked.paint)
    return None


def _weights(shown: bpy.types.Object, name: str) -> np.ndarray:
    group = shown.vertex_groups.get(name)
    if group is None:
        raise ValueError(f"{shown.name} has no vertex group {name!r}: choose the one that says where it matters")
    weights = np.zeros(len(shown.data.vertices), np.float32)
    for vertex in shown.data.vertices:  # Blender gives weights one by one only
        for member in vertex.groups:
            if member.group == group.index:
                weights[vertex.index] = member.weight
    return weights


def _colours(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    attribute = mesh.color_attributes.get(name)
    if attribute is None:
        raise ValueError(f"{mesh.name} has no colour attribute {name!r}: choose the one that says where it matters")
    colours = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", colours)
    return colours.reshape(-1, 4)
