# SPDX-License-Identifier: GPL-3.0-or-later
"""SACHA in Blender: see where a head avatar spends its Gaussians, and compress it.

The add-on copies arrays and shows them. What has to be computed is computed by the engine, `python -m sacha_core`, in a process of its own.
"""

from __future__ import annotations

import bpy

from . import engine_check, looking, making, opening, panel, preferences, running, seeing, settings, steering, telling

bl_info = {  # for installations from a folder; extensions are described by blender_manifest.toml
    "name": "SACHA",
    "author": "The SACHA authors",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > SACHA, File > Import",
    "description": "See where a head avatar spends its Gaussians, and compress it",
    "category": "Import-Export",
}

PARTS = (
    settings,
    preferences,
    running,
    engine_check,
    panel,
    *seeing.PARTS,
    *opening.PARTS,
    *making.PARTS,
    *steering.PARTS,
    *looking.PARTS,
    *telling.PARTS,
)


def register() -> None:
    """Make every class of every part known to Blender, and let parts attach what is no class."""
    for part in PARTS:
        for kind in part.CLASSES:
            bpy.utils.register_class(kind)
    for part in PARTS:
        getattr(part, "attach", _nothing)()


def unregister() -> None:
    """End what still runs, then undo `register` in the opposite order."""
    running.end_now()
    for part in reversed(PARTS):
        getattr(part, "detach", _nothing)()
    for part in reversed(PARTS):
        for kind in reversed(part.CLASSES):
            bpy.utils.unregister_class(kind)


def _nothing() -> None:
    """Most parts have nothing but classes."""
