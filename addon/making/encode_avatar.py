# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding: an avatar, and its motion where there is one, into a `.sacha` file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, running, sources
from ..job import Job
from .encode_options import encode_options, encode_properties

__all__ = ["CLASSES"]


class SachaEncode(bpy.types.Operator, ExportHelper):
    """Compress an avatar into a .sacha file."""

    bl_idname = "sacha.encode"
    bl_label = "Encode"
    bl_description = "Compress the avatar, with the scene's settings where none are given, into a .sacha file"

    filename_ext = ".sacha"
    filter_glob: StringProperty(default="*.sacha", options={"HIDDEN"})
    source: sources.avatar_property("Splat PLY, .sacha file or model folder")
    wait: running.wait_property()
    __annotations__.update(encode_properties())

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine encode."""
        source, target = sources.avatar_source(context, self.source), sources.full_path(self.filepath)
        given = ["--ply", source] if source.suffix.lower() == ".ply" else [source]
        given += [*encode_options(self, context), "-o", target]
        python = preferences.engine_python(context)

        def command(folder: Path) -> list[str]:
            return engine.command(python, "encode", *given, "--json", folder / "report.json")

        def finish(job: Job) -> str:
            return f"Encoded {source.name} to {target.name}: {job.report()['bytes']['total']:,} bytes"

        return running.Work(f"Encoding {source.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaEncode,)
