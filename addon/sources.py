# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user named, as the engine wants it: full paths, and the options that say where the head is."""

from __future__ import annotations

from pathlib import Path

import bpy

__all__ = ["avatar_source", "full_path", "head_options"]

MADE_BY_NAME = "synthetic"  # heads that the engine makes by name are no files


def full_path(named: str) -> Path:
    """Give the path that a field of Blender's means; `//` is the folder of the .blend."""
    return Path(bpy.path.abspath(named)).absolute()


def head_options(context: bpy.types.Context, head: str = "") -> list[str]:
    """Give the engine's options for the head: the one named here, else the one of the scene's settings, and its masks."""
    chosen = context.scene.sacha
    head = head or chosen.head
    options = []
    if head:
        options += ["--head", head if head.startswith(MADE_BY_NAME) else str(full_path(head))]
    if chosen.masks:
        options += ["--masks", str(full_path(chosen.masks))]
    return options


def avatar_source(context: bpy.types.Context, named: str) -> Path:
    """Give the avatar's file: the one named, else the one that the active mesh was opened from.

    Raises:
        ValueError: none is named and the active object is no avatar.
    """
    active = context.object
    shown = active.data.sacha if active is not None and active.type == "MESH" else None
    source = named or (shown.source if shown is not None and shown.kind == "avatar" else "")
    if not source:
        raise ValueError("No avatar: open one, or select the mesh of one that is open")
    return full_path(source)
