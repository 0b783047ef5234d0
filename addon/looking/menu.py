# SPDX-License-Identifier: GPL-3.0-or-later
"""Entries in Blender's menu of exports."""

from __future__ import annotations

import bpy

__all__ = ["CLASSES", "attach", "detach"]

CLASSES = ()


def _export_entries(menu: bpy.types.Menu, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    menu.layout.operator("sacha.export_splats", text="SACHA splats (.ply, .spz)")
    menu.layout.operator("sacha.export_gltf", text="SACHA avatar (.glb)")
    menu.layout.operator("sacha.bake_heat_map", text="SACHA heat map (.png)")


def attach() -> None:
    """Add them."""
    bpy.types.TOPBAR_MT_file_export.append(_export_entries)


def detach() -> None:
    """Remove them."""
    bpy.types.TOPBAR_MT_file_export.remove(_export_entries)
