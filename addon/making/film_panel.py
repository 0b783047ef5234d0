# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of filming: cameras, pictures, and how many there will be."""

from __future__ import annotations

import bpy

from ..seeing.shown import shown_by
from ..telling.lines import draw_sentence
from .heads import cameras_of

__all__ = ["CLASSES"]


class SachaFilmPanel(bpy.types.Panel):
    """Film a dataset of the head."""

    bl_idname = "SACHA_PT_film"
    bl_label = "Film"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 41
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it as it is)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only a head can be filmed."""
        return shown_by(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, scene = self.layout, context.scene
        setup = scene.sacha_making
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.operator("sacha.add_cameras", icon="OUTLINER_OB_CAMERA")
        names = ["film_cameras", "renderer", *(["samples"] if setup.renderer == "CYCLES" else [])]
        for name in (*names, "width", "height", "frame_step", "only_selected", "film_folder"):
            layout.prop(setup, name)
        n_cameras = len(cameras_of(scene))
        n_frames = len(range(scene.frame_start, scene.frame_end + 1, setup.frame_step))
        pictures = f"{n_cameras} cameras by {n_frames:,} frames: {n_cameras * n_frames:,} pictures"
        draw_sentence(layout, context, pictures)
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("sacha.film", icon="RENDER_ANIMATION")


CLASSES = (SachaFilmPanel,)
