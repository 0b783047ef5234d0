# SPDX-License-Identifier: GPL-3.0-or-later
"""Selecting the faces of a region, in Object Mode and in Edit Mode."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty

from .. import bridge, problem
from ..active import mesh_of

__all__ = ["CLASSES", "select_faces"]

REGION = "region"  # the attribute


def select_faces(mesh: bpy.types.Mesh, places: set[int], *, extend: bool) -> int:
    """Select the faces of regions, with their edges and vertices.

    Args:
        mesh: with the attribute `region`; where it is gone, nothing is selected.
        places: numbers of the regions.
        extend: keep what is selected.

    Returns:
        How many faces these regions have.
    """
    if mesh.is_editmode:
        return _select_in_edit_mode(mesh, places, extend)
    if REGION not in mesh.attributes:
        return 0
    chosen = np.isin(bridge.read_face_integers(mesh, REGION), list(places))
    bridge.select_faces(mesh, chosen, extend=extend)
    return int(chosen.sum())


def _select_in_edit_mode(mesh: bpy.types.Mesh, places: set[int], extend: bool) -> int:
    edited = bmesh.from_edit_mesh(mesh)
    regions = edited.faces.layers.int.get(REGION)
    if regions is None:
        return 0
    chosen = [face for face in edited.faces if face[regions] in places and not face.hide]
    edited.select_mode = {"FACE"}
    if not extend:
        for face in edited.faces:
            face.select_set(False)
    for face in chosen:
        face.select_set(True)
    edited.select_flush_mode()
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
    return len(chosen)


class SachaSelectRegion(bpy.types.Operator):
    """Select the faces of a region of the active mesh."""

    bl_idname = "sacha.select_region"
    bl_label = "Select Region"
    bl_description = "Select the faces of a region"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    region: StringProperty(name="Region", description="Name of the region; where empty, the one of the chosen row")
    extend: BoolProperty(name="Extend", description="Keep what is selected already")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be regions."""
        mesh = mesh_of(context)
        return mesh is not None and len(mesh.sacha.regions) > 0

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Select."""
        mesh = mesh_of(context)
        regions = mesh.sacha.regions
        chosen = regions.get(self.region) if self.region else None
        if not self.region and 0 <= mesh.sacha.active_region < len(regions):
            chosen = regions[mesh.sacha.active_region]
        if chosen is None:
            known = ", ".join(regions.keys())
            return problem.tell(self, f"No region {self.region!r}; there are {known}")
        if mesh.is_editmode:
            context.tool_settings.mesh_select_mode = (False, False, True)
        n_faces = select_faces(mesh, {chosen.place}, extend=self.extend)
        self.report({"INFO"}, f"Selected {n_faces:,} faces of {chosen.name}")
        return {"FINISHED"}


CLASSES = (SachaSelectRegion,)
