# SPDX-License-Identifier: GPL-3.0-or-later
"""A motion from a file onto a head that is open: its joints and expressions move, the person stays."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from .. import engine, preferences, running, sources
from ..job import Job
from ..remembered import remember
from . import animating, controls
from .scene_folder import read_scene_folder

__all__ = ["CLASSES"]


class SachaLoadMotion(bpy.types.Operator, ImportHelper):
    """Let the active head move as a file says."""

    bl_idname = "sacha.load_motion"
    bl_label = "Load Motion"
    bl_description = "Let the active head move as a file says: FLAME parameters, or weights of blend shapes (.npz)"
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    filepath: StringProperty(name="Motion", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})
    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a head to move."""
        return controls.head_of(context.object) is not None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        self.wait = False
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine say what the motion is for this head, then write its keys."""
        shown, motion = controls.head_of(context.object), sources.full_path(self.filepath)
        moved, source = remember(shown), sources.full_path(shown.data.sacha.source)
        python, given = preferences.engine_python(context), controls.head_options(shown.data)

        def finish(job: Job) -> str:
            head = moved.require(f"nothing moves as {motion.name} says")
            opened = read_scene_folder(job.folder / "scene")
            rig, animation = opened.parts["rig"], opened.parts["animation"]
            for note in animating.animate(context, head, animation, rig):
                self.report({"WARNING"}, note)
            frames, rate = len(animation.arrays["values"]), animation.values["frame_rate"]
            return f"{head.name} moves as {motion.name} says: {frames} frames at {rate:g} a second"

        return running.Work(
            f"Reading {motion.name}",
            lambda folder: engine.command(
                python, "scene", source, "--out", folder / "scene", "--motion", motion, *given
            ),
            finish,
        )

    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaLoadMotion,)
