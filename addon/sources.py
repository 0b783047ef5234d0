# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user named, as the engine wants it: full paths, and the options that say where the head is."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty

from . import active

__all__ = ["avatar_property", "avatar_source", "full_path", "head_options"]

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


def avatar_property(what: str) -> StringProperty:
    """Make the property by which scripts name an avatar.

    Args:
        what: may be named.
    """
    return StringProperty(
        name="Avatar",
        description=f"{what}; where empty, the one that the active mesh was opened from",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )


def avatar_source(context: bpy.types.Context, named: str) -> Path:
    """Give the avatar's file: the one named, else the one that the active mesh was opened from.

    Raises:
        ValueError: none is named and the active object is no avatar.
    """
    avatar = active.avatar_of(context.object)
    source = named or (avatar.data.sacha.source if avatar is not None else "")
    if not source:
        raise ValueError(active.NO_AVATAR)
    return full_path(source)
