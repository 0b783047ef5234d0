# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be done with trainings that were started: stop one, find one, take one off the list."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import problem, sources
from . import known_runs, run_folder, run_status

__all__ = ["CLASSES", "run_of"]


class SachaStopTraining(bpy.types.Operator):
    """Stop a training; it can go on later."""

    bl_idname = "sacha.stop_training"
    bl_label = "Stop"
    bl_description = "Stop the training; it can go on later where it was"

    model: StringProperty(name="Model", description="Its folder", subtype="DIR_PATH", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Ask its process to end."""
        try:
            run_folder.stop(run_of(self.model))
        except (OSError, ValueError) as error:
            return problem.tell(self, str(error), getattr(error, "kind", ""))
        known_runs.refresh()
        return {"FINISHED"}


class SachaFindTraining(bpy.types.Operator):
    """Show a training that was started elsewhere, or was forgotten."""

    bl_idname = "sacha.find_training"
    bl_label = "Find Training"
    bl_description = "Show a training by its folder: one that another Blender started, or that was taken off the list"

    directory: StringProperty(name="Model", description="Its folder", subtype="DIR_PATH", options={"SKIP_SAVE"})
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Look at it, and keep it in mind."""
        try:
            run = run_of(self.directory)
            known_runs.remember(run)
        except (OSError, ValueError) as error:
            return problem.tell(self, str(error), getattr(error, "kind", ""))
        status = run_status.look(run)
        self.report({"INFO"}, f"{run.model.name}: {status.standing.value}. {status.complaint.message}".strip())
        return {"FINISHED"}


class SachaForgetTraining(bpy.types.Operator):
    """Take a training off the list; its folder stays."""

    bl_idname = "sacha.forget_training"
    bl_label = "Forget"
    bl_description = "Take it off the list; its folder, and what trains in it, stay as they are"

    model: StringProperty(name="Model", description="Its folder", subtype="DIR_PATH", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:  # noqa: ARG002  (Blender's signature)
        """Forget it."""
        known_runs.forget(sources.full_path(self.model))
        return {"FINISHED"}


def run_of(model: str) -> run_folder.Run:
    """Find the training of a folder.

    Raises:
        ValueError: there is none.
    """
    if not model:
        raise ValueError("No training: name its folder")
    run = run_folder.find_run(sources.full_path(model))
    if run is None or run.arguments[:1] != ("train",):
        raise ValueError(f"{sources.full_path(model)} holds no training that was started here")
    return run


CLASSES = (SachaStopTraining, SachaFindTraining, SachaForgetTraining)
