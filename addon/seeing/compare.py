# SPDX-License-Identifier: GPL-3.0-or-later
"""Telling an avatar against another one, and reading its numbers anew: the engine reads, the mesh that is open takes the numbers."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from .. import engine, preferences, running, sources
from ..active import mesh_of
from ..job import Job
from ..opening.scene_folder import read_scene_folder
from ..remembered import remember
from . import numbers
from .division import shown_division, write_division
from .shown import edited, shown_by

__all__ = ["CLASSES"]

CHANGE = "COUNT_CHANGE"  # the view that a comparison begins with


def has_avatar(context: bpy.types.Context) -> bool:
    """Tell whether the active mesh shows an avatar."""
    shown = shown_by(context)
    return shown is not None and shown.kind == "avatar"


def read_anew(
    operator: bpy.types.Operator, context: bpy.types.Context, compared: Path | None = None, views: int = 0
) -> running.Work:
    """Let the engine read the avatar of the active mesh again, on its own or against another one.

    Args:
        operator: that reports notes.
        context: with the mesh.
        compared: another avatar, if any.
        views: in how many views the avatar shall be measured first; 0 leaves it as it is.

    Raises:
        ValueError: the mesh was edited, so that numbers of triangles would come to lie on others, or says nothing of its own regions.
    """
    mesh = mesh_of(context)
    source = sources.full_path(mesh.sacha.source)
    if complaint := edited(mesh):
        raise ValueError(f"{complaint}; open the file anew instead")
    given = [*sources.head_options(context), *([] if compared is None else ["--compare", compared])]
    given += ["--measure", str(views)] if views else []
    python, read = preferences.engine_python(context), remember(mesh)
    own = shown_division(mesh) if mesh.sacha_steering.custom else None  # regions of the user's own stay

    def command(folder: Path) -> list[str]:
        scheme = [] if own is None else ["--scheme", write_division(folder / "own.scheme.npz", own)]
        return engine.command(python, "scene", source, "--out", folder / "scene", *given, *scheme)

    def finish(job: Job) -> str:
        taken = read.require("nothing to put the numbers on")
        numbers.require_source(taken, source)
        opened = read_scene_folder(job.folder / "scene")
        numbers.take(taken, opened, compared=compared)
        for note in opened.notes:
            operator.report({"WARNING"}, note)
        if compared is None:
            return f"Read {source.name} anew: {', '.join(opened.facts)}"
        if any(view.name.upper() == CHANGE for view in opened.views):
            taken.sacha.view = CHANGE
        return f"{source.name} against {compared.name}: {', '.join(opened.facts)}"

    title = f"Measuring {source.name}" if views else f"Reading {source.name}"
    return running.Work(
        title if compared is None else f"Comparing with {compared.name}",
        command,
        finish,
    )


class SachaCompare(bpy.types.Operator, ImportHelper):
    """Show what the active avatar has more or less of than another avatar of the same head."""

    bl_idname = "sacha.compare"
    bl_label = "Compare With..."
    bl_description = "Show where this avatar spends more, and where less, than another avatar of the same head"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.sacha;*.ply", options={"HIDDEN"})
    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be an avatar."""
        return has_avatar(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the other avatar."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine compare.

        Raises:
            ValueError: no other avatar is named, or the mesh was edited.
        """
        if not self.filepath:
            raise ValueError("No avatar to compare with is named")
        return read_anew(self, context, sources.full_path(self.filepath))

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaRefresh(bpy.types.Operator):
    """Read the active avatar's file again, and forget what it was compared with."""

    bl_idname = "sacha.refresh"
    bl_label = "Read Again"
    bl_description = "Read the avatar's file and its scores again, and forget what it was compared with"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be an avatar."""
        return has_avatar(context)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine read.

        Raises:
            ValueError: the mesh was edited.
        """
        return read_anew(self, context)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


class SachaMeasure(bpy.types.Operator):
    """Measure sensitivities, and what regions' modulators, thresholds and ratios are, and show them."""

    bl_idname = "sacha.measure"
    bl_label = "Measure"
    bl_description = (
        "Render the avatar from all sides and measure what each Gaussian is worth: views of sensitivity, modulator, threshold and "
        "pruning ratio follow. The scores are kept in a file beside the avatar's"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    views: IntProperty(name="Views", description="In how many views, about", default=120, min=1)
    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be an avatar."""
        return has_avatar(context)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine measure and read.

        Raises:
            ValueError: the mesh was edited.
        """
        return read_anew(self, context, views=self.views)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaCompare, SachaRefresh, SachaMeasure)
