# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoding: a `.sacha` file back into a splat PLY that other programs read."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, running, sources
from ..job import Job

__all__ = ["CLASSES"]


class SachaDecode(bpy.types.Operator, ExportHelper):
    """Write the Gaussians of a .sacha file as a splat PLY."""

    bl_idname = "sacha.decode"
    bl_label = "Decode to PLY"
    bl_description = "Write the Gaussians of a .sacha file as a splat PLY bound to its head"

    filename_ext = ".ply"
    filter_glob: StringProperty(default="*.ply", options={"HIDDEN"})
    source: sources.avatar_property("The .sacha file")
    motion: StringProperty(
        name="Motion",
        description="Also write the motion, as flame_param.npz, to this file",
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
        source, target = sources.avatar_source(context, self.source), sources.full_path(self.filepath)
        given = sources.head_options(context)
        if self.motion:
            given += ["--motion", str(sources.full_path(self.motion))]
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


CLASSES = (SachaDecode,)
