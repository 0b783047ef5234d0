# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening a file: the engine reads it and says what each triangle is and carries; here it becomes a mesh."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from .. import bridge, engine, preferences, running, sources
from ..job import Job
from ..seeing import numbers
from ..steering.settings import list_regions
from . import cameras, controls, rigging
from .scene_folder import SceneFolder, read_scene_folder

__all__ = ["CLASSES", "SUFFIXES"]

SUFFIXES = (".sacha", ".npz", ".pkl", ".ply", ".obj", ".glb", ".gltf")


class SachaOpen(bpy.types.Operator, ImportHelper):
    """Show an avatar or a head as a mesh whose triangles carry their region and number of Gaussians."""

    bl_idname = "sacha.open"
    bl_label = "Open in SACHA"
    bl_description = "Show an avatar (.sacha, bound .ply) or a head (.npz, .pkl, .obj, .ply, .glb) with its regions, controls and motion"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    # A file dropped on the window comes as `filepath`; what was opened last must not be taken for one.
    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default=";".join(f"*{suffix}" for suffix in SUFFIXES), options={"HIDDEN"})
    head: StringProperty(
        name="Head",
        description="Head model that the file is bound to; where empty, the one of the scene's settings",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    motion: StringProperty(
        name="Motion",
        description="Motion (.npz) that the head shall have instead of the file's own; may be empty",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file, unless one was dropped on the window."""
        self.wait = False
        return (
            self.execute(context) if self.filepath and Path(self.filepath).is_file() else super().invoke(context, event)
        )

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine read the file, then show it."""
        return opening_work(self, context, self.filepath, self.head, self.motion)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaOpenFolder(bpy.types.Operator):
    """Show a trained model, or the head and the cameras of a capture."""

    bl_idname = "sacha.open_folder"
    bl_label = "Open Folder in SACHA"
    bl_description = (
        "Show a trained model in GaussianAvatars' layout, or a capture: its person's head, its motion and its cameras"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    directory: StringProperty(name="Folder", subtype="DIR_PATH", options={"SKIP_SAVE"})
    head: StringProperty(
        name="Head",
        description="Head model that it is bound to; where empty, the one of the scene's settings",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:  # noqa: ARG002  (Blender's)
        """Ask for the folder."""
        self.wait = False
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine read the folder, then show it."""
        return opening_work(self, context, self.directory, self.head)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def opening_work(
    operator: bpy.types.Operator, context: bpy.types.Context, named: str, head: str, motion: str = ""
) -> running.Work:
    """Let the engine read a file or a folder, then show it; notes are the operator's warnings."""
    source, given = sources.full_path(named), sources.head_options(context, head)
    moved = ["--motion", str(sources.full_path(motion))] if motion else []
    python = preferences.engine_python(context)

    def finish(job: Job) -> str:
        opened = read_scene_folder(job.folder / "scene")
        shown, notes = show(context, opened, source)
        controls.remember_head(shown.data, given)
        for note in (*opened.notes, *notes):
            operator.report({"WARNING"}, note)
        return f"Opened {source.name}: {', '.join(opened.facts)}"

    return running.Work(
        f"Opening {source.name}",
        lambda folder: engine.command(python, "scene", source, "--out", folder / "scene", *given, *moved),
        finish,
    )


def show(context: bpy.types.Context, opened: SceneFolder, source: Path) -> tuple[bpy.types.Object, list[str]]:
    """Put an opened file into the scene, as the active object, with its controls, its motion and its cameras.

    Returns:
        The mesh, and notes for the user.

    Raises:
        ValueError: Blender cannot hold its triangles.
    """
    if context.object is not None and context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")  # joints are made in a mode that only one object at a time can be in
    mesh = bridge.new_mesh(opened.name, opened.vertices, opened.faces)
    if opened.uv is not None:
        bridge.texture_coordinates(mesh, "uv", opened.uv)
    numbers.describe(mesh, opened, source)
    list_regions(mesh)

    shown = bpy.data.objects.new(opened.name, mesh)
    _shown_collection(context).objects.link(shown)
    notes = rigging.rig_up(context, shown, opened)
    if "cameras" in opened.parts:
        notes += cameras.add_cameras(context, opened.name, opened.parts["cameras"])
    for other in context.selected_objects:
        other.select_set(False)
    shown.select_set(True)
    context.view_layer.objects.active = shown
    _show_colours_in_views(context)
    return shown, notes


def _shown_collection(context: bpy.types.Context) -> bpy.types.Collection:
    """Give the active collection, or the scene's own where that is hidden: what is hidden cannot be made active."""
    active = context.view_layer.active_layer_collection
    return active.collection if active.is_visible else context.scene.collection


def _show_colours_in_views(context: bpy.types.Context) -> None:
    """Let the 3D views of the window, where they are shaded solid, show the colours of triangles."""
    if context.screen is None:
        return
    for area in context.screen.areas:
        if area.type == "VIEW_3D" and area.spaces.active.shading.type == "SOLID":
            area.spaces.active.shading.color_type = "VERTEX"


CLASSES = (SachaOpen, SachaOpenFolder)
