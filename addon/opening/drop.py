# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars dropped on a 3D view, where Blender hands over what is dropped."""

from __future__ import annotations

import bpy

from ..features import DROPS_FILES

__all__ = ["CLASSES"]

if DROPS_FILES:

    class SachaDrop(bpy.types.FileHandler):
        """Opens avatars that are dropped on a 3D view."""

        bl_idname = "SACHA_FH_open"
        bl_label = "SACHA avatar"
        bl_import_operator = "sacha.open"
        bl_file_extensions = ".sacha"

        @classmethod
        def poll_drop(cls, context: bpy.types.Context) -> bool:
            """Only a 3D view shows an avatar."""
            return context.area is not None and context.area.type == "VIEW_3D"

    CLASSES = (SachaDrop,)
else:
    CLASSES = ()
