# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions of one's own: from face sets or material slots, back to the avatar's, or into a file for the command line."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from .. import engine, preferences, problem, running, sources
from ..job import Job
from ..opening.scene_folder import read_scene_folder
from ..remembered import remember
from ..seeing import numbers
from ..seeing.division import by_face_sets, by_materials, shown_division, write_division
from .settings import list_regions, steerable

__all__ = ["CLASSES"]


class SachaRegionsFrom(bpy.types.Operator):
    """Divide the head into regions as its face sets or materials say."""

    bl_idname = "sacha.regions_from"
    bl_label = "Regions From"
    bl_description = "Divide the head into regions of your own, for what is shown and for the budget"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    kind: EnumProperty(
        name="From",
        items=[
            ("FACE_SETS", "Face Sets", "Each face set of Sculpt Mode becomes a region"),
            ("MATERIALS", "Materials", "Each material slot that faces have becomes a region, in its viewport colour"),
            ("AVATAR", "The Avatar's", "The regions that the avatar was trained with"),
        ],
    )
    wait: running.wait_property()

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine count and colour anew.

        Raises:
            ValueError: the mesh was edited, or says nothing of regions.
        """
        mesh = steerable(context)
        makers = {"FACE_SETS": by_face_sets, "MATERIALS": by_materials}
        division = makers[self.kind](mesh) if self.kind in makers else None
        source, given = sources.full_path(mesh.sacha.source), sources.head_options(context)
        python, divided = preferences.engine_python(context), remember(mesh)

        def command(folder: Path) -> list[str]:
            own = [] if division is None else ["--scheme", write_division(folder / "own.scheme.npz", division)]
            return engine.command(python, "scene", source, "--out", folder / "scene", *given, *own)

        def finish(job: Job) -> str:
            taken = divided.require("nothing to divide")
            numbers.require_source(taken, source)
            numbers.take(taken, read_scene_folder(job.folder / "scene"))
            taken.sacha_steering.custom = division is not None
            taken.sacha_steering.outcome.clear()  # of other regions
            list_regions(taken)
            regions = [row.name for row in taken.sacha.regions]
            return f"{taken.name} has {len(regions)} regions: {', '.join(regions)}"

        return running.Work(f"Dividing {divided.name}", command, finish)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaSaveRegions(bpy.types.Operator, ExportHelper):
    """Write the regions that are shown as a scheme file."""

    bl_idname = "sacha.save_regions"
    bl_label = "Save Regions"
    bl_description = "Write the regions that are shown into a file, for the engine's option --scheme"

    filename_ext = ".npz"
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write it."""
        path = sources.full_path(self.filepath)
        try:
            mesh = steerable(context)
            write_division(path, shown_division(mesh))
        except ValueError as error:
            return problem.tell(self, str(error))
        except OSError as error:
            return problem.tell(self, f"{path}: {error.strerror or error}")
        self.report({"INFO"}, f"Saved {len(mesh.sacha.regions)} regions to {path.name}")
        return {"FINISHED"}


class SachaListRegions(bpy.types.Operator):
    """Give each region of the active mesh a row of the budget."""

    bl_idname = "sacha.list_regions"
    bl_label = "Set Up Budget"
    bl_description = "Give each region that is shown a row of the budget"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """List them."""
        try:
            list_regions(steerable(context))
        except ValueError as error:
            return problem.tell(self, str(error))
        return {"FINISHED"}


CLASSES = (SachaRegionsFrom, SachaSaveRegions, SachaListRegions)
