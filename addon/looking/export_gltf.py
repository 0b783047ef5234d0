# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF out: the head with its animation and a heat map, or one frame of splats, for the web and for engines."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, running, sources
from ..job import Job

__all__ = ["CLASSES"]


class SachaExportGltf(bpy.types.Operator, ExportHelper):
    """Write the active avatar as glTF."""

    bl_idname = "sacha.export_gltf"
    bl_label = "Export glTF"
    bl_description = (
        "Write the avatar as glTF: its head with skin, morphs, motion and heat map, or its splats in one frame"
    )

    filename_ext = ".glb"
    filter_glob: StringProperty(default="*.glb", options={"HIDDEN"})
    content: EnumProperty(
        name="Content",
        description="What is written",
        items=[
            ("HEAD", "Head", "The head's mesh with skin, morphs and the motion, painted by region or by a texture"),
            ("SPLATS", "Splats", "The Gaussians of one frame (KHR_gaussian_splatting)"),
        ],
    )
    texture: StringProperty(
        name="Texture",
        description="Picture on the head, such as a baked heat map; where empty, the map of its regions",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    frame: IntProperty(name="Frame", description="Frame of the motion, from 0: of splats", default=0, min=0)
    source: sources.avatar_property("The avatar's file")
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine write it."""
        source, target = sources.avatar_source(context, self.source), sources.full_path(self.filepath)
        python = preferences.engine_python(context)
        options: list[str | Path] = ["--format", f"gltf-{self.content.lower()}"]
        if self.content == "SPLATS":
            options += ["--frames", str(self.frame)]
        elif self.texture:
            options += ["--texture", sources.full_path(self.texture)]
        if context.scene.sacha.motion:
            options += ["--motion", sources.full_path(context.scene.sacha.motion)]
        options += sources.head_options(context)

        def command(folder: Path) -> list[str]:
            return engine.command(python, "export", source, "-o", target, *options, "--json", folder / "report.json")

        def finish(job: Job) -> str:
            told = json.loads((job.folder / "report.json").read_text(encoding="utf-8"))
            return f"Wrote {target.name}: {told['bytes'] / 1e6:,.1f} MB"

        return running.Work(f"Exporting {source.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaExportGltf,)
