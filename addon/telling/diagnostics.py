# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that copies diagnostics."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from .. import engine, preferences, running, sources
from ..job import Job
from .report import report

__all__ = ["CLASSES"]


class SachaCopyDiagnostics(bpy.types.Operator):
    """Copy what somebody who helps would ask for, after asking the engine what it has."""

    bl_idname = "sacha.copy_diagnostics"
    bl_label = "Copy Diagnostics"
    bl_description = "Copy versions, paths, settings and the last problem to the clipboard, for whoever helps you"

    filepath: StringProperty(
        name="File",
        description="Also write them to this text file",
        subtype="FILE_PATH",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    wait: running.wait_property()

    def work(self, context: bpy.types.Context) -> running.Work:
        """Ask the engine; copy, whatever it says."""
        python = preferences.engine_python(context)

        def finish(job: Job) -> str:
            return self._copy(context, _answer(job.printed()))

        def failed(job: Job) -> str:
            return self._copy(context, job.complaint())

        return running.Work("Asking the engine", lambda folder: engine.probe(python), finish, failed=failed)  # noqa: ARG005

    invoke = running.invoke

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy at once where the engine cannot be asked."""
        try:
            preferences.engine_python(context)
        except engine.EngineMissingError as error:
            self.report({"INFO"}, self._copy(context, str(error)))
            return {"FINISHED"}
        if running.now() is not None:
            self.report({"INFO"}, self._copy(context, "not asked: it is busy"))
            return {"FINISHED"}
        return running.execute(self, context)

    modal = running.modal
    cancel = running.cancel

    def _copy(self, context: bpy.types.Context, asked: str) -> str:
        text = report(context, asked)
        context.window_manager.clipboard = text
        if self.filepath:
            sources.full_path(self.filepath).write_text(text, encoding="utf-8")
        return "Diagnostics are on the clipboard"


def _answer(printed: str) -> str:
    """Say what the engine answered, or that it is not usable and why."""
    try:
        return engine.describe(printed)
    except (engine.EngineMissingError, ValueError) as error:
        return str(error)


CLASSES = (SachaCopyDiagnostics,)
