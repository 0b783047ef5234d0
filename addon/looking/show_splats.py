# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats in the view: the avatar's Gaussians as an object that follows its head."""

from __future__ import annotations

from pathlib import Path

import bpy

from .. import engine, preferences, running, sources
from ..job import Job
from ..remembered import remember
from .posed_head import chosen_head, save_vertices, source_of, splats_on
from .splat_data import make_data, read_splats
from .splat_nodes import add_modifier

__all__ = ["CLASSES"]


class SachaShowSplats(bpy.types.Operator):
    """Show the Gaussians of the active avatar as splats that follow its head."""

    bl_idname = "sacha.show_splats"
    bl_label = "Show Splats"
    bl_description = "Show the avatar's Gaussians in the view, as splats that follow the head"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    wait: running.wait_property()

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine lay the Gaussians out, then make them points."""
        return _work(context)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaUpdateSplats(bpy.types.Operator):
    """Bring the splats of the active avatar to its present file and the pose of this frame."""

    bl_idname = "sacha.update_splats"
    bl_label = "Update Splats"
    bl_description = "Bring the splats to the head's present file and to its pose at this frame, where they stay if they do not follow it"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be splats."""
        return _chosen_splats(context) is not None

    def work(self, context: bpy.types.Context) -> running.Work:
        """Do what shows them, to those that are there."""
        return _work(context)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaRemoveSplats(bpy.types.Operator):
    """Take the splats of the active avatar out of the scene."""

    bl_idname = "sacha.remove_splats"
    bl_label = "Remove Splats"
    bl_description = "Take the avatar's splats out of the scene"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be splats."""
        return _chosen_splats(context) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove the object and its points."""
        splats = _chosen_splats(context)
        head, data = splats.sacha_splats.head, splats.data
        bpy.data.objects.remove(splats)
        _remove_unused(data)
        context.view_layer.objects.active = head
        return {"FINISHED"}


def _chosen_splats(context: bpy.types.Context) -> bpy.types.Object | None:
    """Give the splats of the avatar that is looked at."""
    head = chosen_head(context)
    return None if head is None else splats_on(head)


def _work(context: bpy.types.Context) -> running.Work:
    """Let the engine lay out the Gaussians of the avatar that is looked at, then make them points."""
    head, source = source_of(context)
    python, given, laid = preferences.engine_python(context), sources.head_options(context), remember(head)
    depsgraph = context.evaluated_depsgraph_get()

    def command(folder: Path) -> list[str]:
        save_vertices(head, depsgraph, folder / "vertices.npy")
        pose = ("--vertices", folder / "vertices.npy")
        return engine.command(python, "splats", source, *pose, "--out", folder / "splats", *given)

    def finish(job: Job) -> str:
        carrier = laid.require("nothing to show splats on")
        arrays, told = read_splats(job.folder / "splats")
        data, native = make_data(f"{carrier.name} splats", arrays, told)
        splats = _put(context, carrier, data)
        settings = splats.sacha_splats
        settings.source, settings.n_faces, settings.head = str(source), told["n_faces"], carrier
        add_modifier(splats, native=native)
        return f"{len(arrays['position']):,} splats of {source.name}"

    return running.Work(f"Showing splats of {source.name}", command, finish)


def _put(context: bpy.types.Context, head: bpy.types.Object, data: bpy.types.ID) -> bpy.types.Object:
    """Give a head's object of splats this data; make the object where there is none."""
    splats = splats_on(head)
    if splats is not None:
        old, splats.data = splats.data, data
        _remove_unused(old)
        return splats
    splats = bpy.data.objects.new(data.name, data)
    for collection in head.users_collection or [context.collection]:
        collection.objects.link(splats)
    splats.parent = head
    return splats


def _remove_unused(data: bpy.types.ID) -> None:
    """Remove points that nothing uses any more."""
    if data.users == 0:
        (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.pointclouds).remove(data)


CLASSES = (SachaShowSplats, SachaUpdateSplats, SachaRemoveSplats)
