# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panels of pictures: splats, preview, exports."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..seeing.legend import draw_legend
from ..telling.lines import draw_sentence
from . import pictures
from .posed_head import chosen_head, splats_on

__all__ = ["CLASSES"]

SIZE = 8.0  # of a preview in the sidebar, in lines


class SachaLookPanel(bpy.types.Panel):
    """Splats of the avatar in the view, and what leaves Blender."""

    bl_idname = "SACHA_PT_look"
    bl_label = "Look"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 30

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only an avatar has Gaussians to look at."""
        return chosen_head(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, head = self.layout, chosen_head(context)
        layout.use_property_split = True
        layout.operator_context = "INVOKE_DEFAULT"
        splats = splats_on(head)
        if splats is None:
            layout.operator("sacha.show_splats", icon="POINTCLOUD_DATA")
        else:
            _draw_splats(layout, context, head, splats)
        column = layout.column(align=True)
        column.operator("sacha.export_splats", text="Export Splats...", icon="EXPORT")
        column.operator("sacha.export_gltf", text="Export glTF...", icon="EXPORT")
        column.operator("sacha.bake_heat_map", text="Bake Heat Map...", icon="TEXTURE")


def _draw_splats(
    layout: bpy.types.UILayout, context: bpy.types.Context, head: bpy.types.Object, splats: bpy.types.Object
) -> None:
    """Draw how splats are shown, and what is to be known of them."""
    settings = splats.sacha_splats
    if Path(settings.source) != Path(bpy.path.abspath(head.data.sacha.source)).absolute():
        draw_sentence(layout, context, "These are splats of another file: update them", icon="INFO")
    if settings.follow and len(head.data.polygons) != settings.n_faces:
        draw_sentence(layout, context, "The mesh was edited: splats stay where they were", icon="ERROR")
    row = layout.row(align=True)
    row.operator("sacha.update_splats", text="Update", icon="FILE_REFRESH")
    row.operator("sacha.remove_splats", text="Remove", icon="X")
    row.prop(splats, "hide_viewport", text="", emboss=False)
    layout.prop(head, "hide_viewport", text="Hide the Head")
    column = layout.column()
    for name in ("follow", "soft", "size", "least_opacity"):
        column.prop(settings, name)
    if settings.soft:
        draw_sentence(layout, context, "Cycles: raise Transparent in Light Paths to 256", icon="INFO")


class SachaPreviewPanel(bpy.types.Panel):
    """The avatar as the engine draws it."""

    bl_idname = "SACHA_PT_preview"
    bl_label = "Preview"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_parent_id = "SACHA_PT_look"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, chosen = self.layout, context.scene.sacha_looking
        layout.use_property_decorate = False
        layout.operator_context = "INVOKE_DEFAULT"
        layout.prop(chosen, "level", text="Draw")
        column = layout.column(align=True)
        column.label(text="Compared with")
        column.prop(chosen, "against", text="")
        layout.prop(chosen, "error")
        if chosen.error != "NONE":
            layout.prop(chosen, "brightest_flip" if chosen.error == "FLIP" else "brightest")
            if chosen.level == "FILE" and not chosen.against:
                draw_sentence(layout, context, "For an error choose a level, or an avatar to compare with", icon="INFO")
        if context.scene.camera is None:
            draw_sentence(layout, context, "The scene has no camera: add one", icon="INFO")
        layout.operator("sacha.render_preview", icon="RENDER_STILL")
        if chosen.told:
            draw_sentence(layout, context, chosen.told)
        for name in (pictures.PREVIEW, pictures.ERROR):
            image = pictures.picture(name)
            if image is not None:
                layout.label(text=name)
                layout.template_icon(icon_value=layout.icon(image), scale=SIZE)
        if len(chosen.legend):
            draw_legend(layout.column(align=True), chosen.legend)


CLASSES = (SachaLookPanel, SachaPreviewPanel)
