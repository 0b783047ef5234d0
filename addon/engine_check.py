# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that asks the engine's Python what it has."""

from __future__ import annotations

import bpy

from . import engine, preferences, running
from .job import Job

__all__ = ["CLASSES"]


class SachaCheckEngine(bpy.types.Operator):
    """Ask the engine's Python what it has, and show the answer in the preferences."""

    bl_idname = "sacha.check_engine"
    bl_label = "Check Engine"
    bl_description = "Ask the engine's Python what it has"

    wait: running.wait_property()

    def work(self, context: bpy.types.Context) -> running.Work:
        """Ask; keep the answer where the preferences show it."""
        shown = context.preferences.addons[__package__].preferences
        shown.found = ""
        python = preferences.engine_python(context)

        def finish(job: Job) -> str:
            try:
                shown.found = engine.describe(job.printed())
            except engine.EngineMissingError as error:
                shown.found = str(error)
                raise
            return shown.found

        return running.Work("Asking the engine", lambda folder: engine.probe(python), finish)  # noqa: ARG005

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


CLASSES = (SachaCheckEngine,)
