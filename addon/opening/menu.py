# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's File menu."""

from __future__ import annotations

import bpy

__all__ = ["CLASSES", "attach", "detach"]

CLASSES = ()


def _import_entry(menu: bpy.types.Menu, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    menu.layout.operator("sacha.open", text="SACHA avatar or head (.sacha, .npz, .ply, .obj, .glb)")
    menu.layout.operator("sacha.open_folder", text="SACHA model or capture (folder)")


def attach() -> None:
    """Add them."""
    bpy.types.TOPBAR_MT_file_import.append(_import_entry)


def detach() -> None:
    """Remove them."""
    bpy.types.TOPBAR_MT_file_import.remove(_import_entry)
