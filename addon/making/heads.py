# SPDX-License-Identifier: GPL-3.0-or-later
"""Which head is meant, and by which cameras it is filmed."""

from __future__ import annotations

import bpy

from ..opening import controls

__all__ = ["cameras_of", "head_of"]


def head_of(context: bpy.types.Context) -> bpy.types.Object:
    """Give the head that is meant: the active mesh, or the one that the active armature moves.

    Raises:
        ValueError: there is none, or it has no controls.
    """
    active = context.object
    candidates = [] if active is None else [active, *active.children]
    for shown in candidates:
        if shown.type == "MESH" and shown.data.sacha.kind:
            if controls.armature_of(shown) is None:
                raise ValueError(f"{shown.name} has no controls: open its avatar or head model, not its mesh alone")
            return shown
    raise ValueError("No head: open one, or select the mesh of one that is open")


def cameras_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Give the cameras that film: those of the chosen collection, else all of the scene, by name."""
    chosen = scene.sacha_making.film_cameras
    objects = scene.objects if chosen is None else chosen.all_objects
    return sorted((thing for thing in objects if thing.type == "CAMERA"), key=lambda camera: camera.name)
