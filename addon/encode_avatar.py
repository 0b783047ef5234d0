# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding: an avatar, and its motion where there is one, into a `.sacha` file."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from . import engine, preferences, running
from .decode_avatar import avatar_source
from .job import Job
from .open_file import absolute_head

__all__ = ["CLASSES"]


class SachaEncode(bpy.types.Operator, ExportHelper):
    """Compress an avatar into a .sacha file."""

    bl_idname = "sacha.encode"
    bl_label = "Encode"
    bl_description = "Compress the avatar, with head, motion and level of the scene's settings, into a .sacha file"

    filename_ext = ".sacha"
    filter_glob: StringProperty(default="*.sacha", options={"HIDDEN"})
    source: StringProperty(
        name="Avatar",
        description="Splat PLY bound to a head; where empty, the one that the active mesh was opened from",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine encode."""
        chosen = context.scene.sacha
        source = avatar_source(self.source, context)
        target = Path(bpy.path.abspath(self.filepath)).absolute()
        given = ["--head", absolute_head(chosen.head)] if chosen.head else []
        if chosen.motion:
            given += ["--motion", str(Path(bpy.path.abspath(chosen.motion)).absolute())]
        python, level = preferences.engine_python(context), str(chosen.level)

        def command(folder: Path) -> list[str]:
            report = ["--json", folder / "report.json"]
            return engine.command(python, "encode", "--ply", source, *given, "--level", level, "-o", target, *report)

        def finish(job: Job) -> str:
            told = json.loads((job.folder / "report.json").read_text(encoding="utf-8"))
            return f"Encoded {source.name} to {target.name}: {told['bytes']['total']:,} bytes"

        return running.Work(f"Encoding {source.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaEncode,)
