# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that the engine drew, as images of the .blend."""

from __future__ import annotations

from pathlib import Path

import bpy

__all__ = ["ERROR", "PREVIEW", "TRUTH", "picture", "remove", "show", "take"]

PREVIEW, TRUTH, ERROR = "SACHA Preview", "SACHA Uncompressed", "SACHA Error"
OURS = (PREVIEW, TRUTH, ERROR)


def picture(name: str) -> bpy.types.Image | None:
    """Give one of our images, where it is there."""
    return bpy.data.images.get(name)


def take(name: str, path: Path) -> bpy.types.Image:
    """Make a file the image of that name, kept inside the .blend; whoever showed the old one shows the new one.

    Raises:
        ValueError: Blender cannot read the file.
    """
    image, old = bpy.data.images.load(str(path), check_existing=False), bpy.data.images.get(name)
    if not image.has_data and not image.size[0]:
        bpy.data.images.remove(image)
        raise ValueError(f"Blender cannot read the picture {path.name}")
    image.pack()
    if old is not None:
        old.user_remap(image)
        bpy.data.images.remove(old)
    image.name, image.use_fake_user = name, True  # kept though nothing but the sidebar shows it
    image.filepath_raw = f"//{name}.png"  # the engine's file is about to go; the picture is packed
    return image


def remove(name: str) -> None:
    """Remove one of our images, where it is there."""
    image = picture(name)
    if image is not None:
        bpy.data.images.remove(image)


def show(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in the window's image editors that show nothing else of the user's."""
    screens = [] if context.window_manager is None else [window.screen for window in context.window_manager.windows]
    for area in (area for screen in screens for area in screen.areas if area.type == "IMAGE_EDITOR"):
        shown = area.spaces.active.image
        if shown is None or shown.name in OURS:
            area.spaces.active.image = image
        area.tag_redraw()
