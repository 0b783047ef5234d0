# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats out: frames of the avatar as the files that splat viewers open."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, running, sources
from ..job import Job
from .posed_head import save_vertices, source_of

__all__ = ["CLASSES"]


class SachaExportSplats(bpy.types.Operator, ExportHelper):
    """Write frames of the active avatar as splats."""

    bl_idname = "sacha.export_splats"
    bl_label = "Export Splats"
    bl_description = "Write the avatar's Gaussians, frame by frame of its motion, for splat viewers: a file, or a folder of numbered files"

    filename_ext = ""
    format: EnumProperty(
        name="Format",
        description="What is written",
        items=[
            ("PLY", "PLY", "As 3D Gaussian Splatting has it, which every splat viewer opens"),
            ("SPZ", "SPZ", "A tenth of the size; takes the program splat-transform"),
        ],
    )
    pose: EnumProperty(
        name="Pose",
        description="How the head is posed",
        items=[
            ("MOTION", "Motion", "Frames of the avatar's own motion, or of the one in the scene's settings"),
            ("SCENE", "As It Stands", "The active head as it stands in the scene at this frame, however it is posed"),
        ],
    )
    frames: StringProperty(
        name="Frames",
        description="One frame (12), or FROM:TO or FROM:TO:STEP as in Python, from 0; a lone colon means all",
        default=":",
    )
    source: sources.avatar_property("The avatar's file")
    wait: running.wait_property()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where to write."""
        self.wait = False
        return super().invoke(context, event)

    def check(self, context: bpy.types.Context) -> bool:  # noqa: ARG002  (Blender's signature)
        """Leave the name as it was typed: it may be a folder's."""
        return False

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine write them."""
        source, target = sources.avatar_source(context, self.source), sources.full_path(self.filepath)
        python, options = preferences.engine_python(context), ["--format", self.format.lower()]
        head, depsgraph = source_of(context)[0] if self.pose == "SCENE" else None, context.evaluated_depsgraph_get()
        if head is not None:
            options += ["--vertices", "vertices.npy"]  # in the job's folder, where the engine works
        else:
            options += ["--frames", self.frames]
            if context.scene.sacha.motion:
                options += ["--motion", sources.full_path(context.scene.sacha.motion)]
        options += sources.head_options(context)

        def command(folder: Path) -> list[str]:
            if head is not None:
                save_vertices(head, depsgraph, folder / "vertices.npy")
            return engine.command(python, "export", source, "-o", target, *options, "--json", folder / "report.json")

        def finish(job: Job) -> str:
            told = json.loads((job.folder / "report.json").read_text(encoding="utf-8"))
            n_files = len(told["files"])
            return f"Wrote {n_files} frame{'s' * (n_files != 1)} to {target.name}: {told['bytes'] / 1e6:,.1f} MB"

        return running.Work(f"Exporting {source.name}", command, finish)

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaExportSplats,)
