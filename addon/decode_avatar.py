# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoding: a `.sacha` file back into a splat PLY that other programs read."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from . import engine, preferences, running
from .job import Job
from .open_file import absolute_head

__all__ = ["CLASSES"]


class SachaDecode(bpy.types.Operator, ExportHelper):
    """Write the Gaussians of a .sacha file as a splat PLY."""

    bl_idname = "sacha.decode"
    bl_label = "Decode to PLY"
    bl_description = "Write the Gaussians of a .sacha file as a splat PLY bound to its head"

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})
    source: StringProperty(
        name="Avatar",
        description="The .sacha file; where empty, the one that the active mesh was opened from",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine decode."""
        source = avatar_source(self.source, context)
        target = Path(bpy.path.abspath(self.filepath)).absolute()
        head = context.scene.sacha.head
        given = ["--head", absolute_head(head)] if head else []
        python = preferences.engine_python(context)

        def finish(job: Job) -> str:  # noqa: ARG001  (the PLY is all there is)
            return f"Decoded {source.name} to {target.name}"

        return running.Work(
            f"Decoding {source.name}",
            lambda folder: engine.command(python, "decode", source, "--ply", target, *given),  # noqa: ARG005
            finish,
        )

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def avatar_source(named: str, context: bpy.types.Context) -> Path:
    """Give the avatar's file: the one named, else the one that the active mesh was opened from.

    Raises:
        ValueError: none is named and the active object is no avatar.
    """
    shown = context.object.data.sacha if context.object is not None and context.object.type == "MESH" else None
    source = named or (shown.source if shown is not None and shown.kind == "avatar" else "")
    if not source:
        raise ValueError("No avatar: open one, or select the mesh of one that is open")
    return Path(bpy.path.abspath(source)).absolute()


CLASSES = (SachaDecode,)
