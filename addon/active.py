# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the things that were opened here the user means."""

from __future__ import annotations

import bpy

__all__ = ["NO_AVATAR", "avatar_of", "mesh_of", "opened_by"]

NO_AVATAR = "No avatar: open one, or select the mesh of one that is open"


def opened_by(thing: bpy.types.Object | None) -> bpy.types.Object | None:
    """Give the object that was opened here and that a thing is, or carries as its joints; None where there is none."""
    if thing is None:
        return None
    for one in (thing, *(thing.children if thing.type == "ARMATURE" else ())):
        if one.type == "MESH" and one.data.sacha.kind:
            return one
    return None


def avatar_of(thing: bpy.types.Object | None) -> bpy.types.Object | None:
    """Give the same where it is an avatar; None where it is a head or a mesh alone."""
    shown = opened_by(thing)
    return shown if shown is not None and shown.data.sacha.kind == "avatar" else None


def mesh_of(context: bpy.types.Context) -> bpy.types.Mesh | None:
    """Give the mesh of the active object, or the one that the active joints carry; None where it is not ours."""
    shown = opened_by(context.object)
    return None if shown is None else shown.data
