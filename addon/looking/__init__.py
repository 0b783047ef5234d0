# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of the avatar itself: splats in the view, previews drawn by the engine, textures and files for other programs."""

from __future__ import annotations

from . import (
    bake_heat_map,
    export_gltf,
    export_splats,
    menu,
    panel,
    render_preview,
    settings,
    show_splats,
    splat_settings,
)

PARTS = (settings, splat_settings, show_splats, render_preview, bake_heat_map, export_splats, export_gltf, menu, panel)
