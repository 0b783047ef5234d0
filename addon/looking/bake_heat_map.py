# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map: the colours that a mesh shows, baked into a texture that any program can put on it."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import bridge, engine, preferences, running, sources
from ..active import opened_by
from ..job import Job
from ..remembered import remember

__all__ = ["CLASSES", "MATERIAL"]

MATERIAL, UV_MAP = "SACHA Heat Map", "uv"


class SachaBakeHeatMap(bpy.types.Operator, ExportHelper):
    """Bake the colours that the active mesh shows into a texture."""

    bl_idname = "sacha.bake_heat_map"
    bl_label = "Bake Heat Map"
    bl_description = "Paint the colours of the view that is shown into a texture, by the mesh's UV map (one is made where it has none)"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    filename_ext = ".png"
    filter_glob: StringProperty(default="*.png", options={"HIDDEN"})
    size: IntProperty(
        name="Size",
        description="Width and height of the texture, pixels; where not given, the scene's",
        default=2048,
        min=16,
        max=16384,
        options={"SKIP_SAVE"},
    )
    material: BoolProperty(
        name="Put It on the Mesh",
        description="Give the mesh a material with this texture, which exporters carry along",
        default=True,
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        if not self.properties.is_property_set("size"):
            self.size = context.scene.sacha_looking.texture_size
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Hand colours and texture coordinates to the engine, then take its texture over."""
        head = opened_by(context.object)
        if head is None:
            raise ValueError("No head: open one, or select the mesh of one that is open")
        python, target, shown = (
            preferences.engine_python(context),
            sources.full_path(self.filepath),
            remember(head.data),
        )
        size = self.size if self.properties.is_property_set("size") else context.scene.sacha_looking.texture_size

        def command(folder: Path) -> list[str]:
            _save_mesh(head.data, folder)
            return engine.command(
                python, "bake", folder, "-o", target, "--size", str(size), "--json", folder / "report.json"
            )

        def finish(job: Job) -> str:
            told = json.loads((job.folder / "report.json").read_text(encoding="utf-8"))
            baked = shown.require(f"nothing wears {target.name}, which is written to {target.parent}")
            if len(baked.polygons) != told["n_triangles"]:
                raise ValueError(
                    f"The texture is written to {target.name}, but the mesh {baked.name!r} has changed meanwhile"
                )
            if told["unwrapped"]:
                bridge.texture_coordinates(baked, UV_MAP, np.load(job.folder / "uv.npy", allow_pickle=False))
            image = bpy.data.images.load(str(target), check_existing=True)
            image.reload()
            if self.material:
                _put_on(baked, image)
            return f"Baked {size} x {size} pixels to {target.name}"

        return running.Work(f"Baking {target.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def _save_mesh(mesh: bpy.types.Mesh, folder: Path) -> None:
    """Write the colours that a mesh shows, and its texture coordinates, or where it has none what they can be made of.

    Raises:
        ValueError: it shows no colours, its faces are no triangles, or a triangle has several colours.
    """
    n_faces, shown = len(mesh.polygons), mesh.color_attributes.active_color
    if len(mesh.loops) != 3 * n_faces:
        raise ValueError("The mesh was edited: not all its faces are triangles, so there is no one colour for each")
    if shown is None or shown.domain != "CORNER":
        raise ValueError("The mesh shows no colours of its triangles: choose a view first")
    colours = np.empty(4 * len(mesh.loops), np.float32)
    shown.data.foreach_get("color", colours)
    colours = colours.reshape(n_faces, 3, 4)
    if not (colours == colours[:, :1]).all():
        raise ValueError(f"The colours {shown.name!r} change within triangles: choose a view first")
    np.save(folder / "colours.npy", colours[:, 0])
    if mesh.uv_layers.active is not None:
        uv = np.empty(2 * len(mesh.loops), np.float32)
        mesh.uv_layers.active.uv.foreach_get("vector", uv)
        np.save(folder / "uv.npy", uv.reshape(n_faces, 3, 2))
        return
    vertices, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.loops), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", corners)
    np.save(folder / "vertices.npy", bridge.to_engine(vertices.reshape(-1, 3)))
    np.save(folder / "faces.npy", corners.reshape(n_faces, 3))


def _put_on(mesh: bpy.types.Mesh, image: bpy.types.Image) -> None:
    """Give a mesh the material of its heat map, with this texture."""
    slot = _heat_map_slot(mesh)
    material = mesh.materials[slot]
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    texture = next((node for node in nodes if node.type == "TEX_IMAGE"), None) or nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"  # borders of triangles stay hard
    surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    mesh.polygons.foreach_set("material_index", np.full(len(mesh.polygons), slot, np.int32))


def _heat_map_slot(mesh: bpy.types.Mesh) -> int:
    """Give the slot with a heat map's material that no other mesh has; a copy of a mesh comes with the material of the first."""
    slots = (slot for slot, worn in enumerate(mesh.materials) if worn is not None and worn.name.startswith(MATERIAL))
    slot = next(slots, None)
    if slot is None:
        mesh.materials.append(bpy.data.materials.new(f"{MATERIAL} {mesh.name}"))
        return len(mesh.materials) - 1
    if mesh.materials[slot].users - mesh.materials[slot].use_fake_user > 1:
        mesh.materials[slot] = bpy.data.materials.new(f"{MATERIAL} {mesh.name}")
    return slot


CLASSES = (SachaBakeHeatMap,)
