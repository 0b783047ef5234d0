# SPDX-License-Identifier: GPL-3.0-or-later
"""Which mesh the user means."""

from __future__ import annotations

import bpy

__all__ = ["mesh_of"]


def mesh_of(context: bpy.types.Context) -> bpy.types.Mesh | None:
    """Give the mesh of the active object, or the one that the active joints carry; None where it is not ours."""
    active = context.object
    if active is None:
        return None
    for one in (active, *(active.children if active.type == "ARMATURE" else ())):
        if one.type == "MESH" and one.data.sacha.kind:
            return one.data
    return None
