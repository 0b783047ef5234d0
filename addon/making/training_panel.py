# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel of trainings: set one up, watch those that go on, find the finished ones."""

from __future__ import annotations

import bpy

from ..advice import advice
from ..features import draw_progress
from ..telling.lines import draw_sentence
from . import known_runs
from .run_status import Standing, Status

__all__ = ["CLASSES"]

SHOWN_LINES = 6  # of a log
ICONS = {
    Standing.RUNNING: "PLAY",
    Standing.STOPPING: "PAUSE",
    Standing.FINISHED: "CHECKMARK",
    Standing.STOPPED: "PAUSE",
    Standing.FAILED: "ERROR",
    Standing.ELSEWHERE: "QUESTION",
}


class SachaTrainingPanel(bpy.types.Panel):
    """Train avatars."""

    bl_idname = "SACHA_PT_training"
    bl_label = "Train"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "SACHA"
    bl_parent_id = "SACHA_PT_main"
    bl_order = 42
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it as it is)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw it."""
        layout, setup = self.layout, context.scene.sacha_making
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in ("dataset", "model", "variant", "iterations", "shrink", "seed", "device", "finetune"):
            layout.prop(setup, name)
        row = layout.row()
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("sacha.train", icon="PLAY")
        row.operator("sacha.find_training", text="Find...", icon="VIEWZOOM")
        for status in known_runs.shown():
            _draw_run(context, layout.box(), status)


def _draw_run(context: bpy.types.Context, box: bpy.types.UILayout, status: Status) -> None:
    """Draw one training: where it stands, how long it will take, what can be done."""
    model, said = str(status.run.model), status.said
    heading = box.row()
    heading.label(text=f"{status.run.model.name}: {status.standing.value}", icon=ICONS[status.standing])
    heading.operator("sacha.forget_training", text="", icon="X", emboss=False).model = model
    if status.goes_on:
        steps = f"{said.stage} {said.done:,}/{said.total:,}" if said.stage else "Starting"
        draw_progress(box, said.fraction, ", ".join(filter(None, (steps, said.left))))
        if said.values:
            box.label(text=said.figures)
    if status.complaint.message:
        draw_sentence(box, context, status.complaint.message)
        draw_sentence(box, context, advice(status.complaint.kind))
    if status.log and status.standing in {Standing.RUNNING, Standing.FAILED}:
        column = box.column(align=True)
        for line in status.log[-SHOWN_LINES:]:
            column.label(text=line)
    row = box.row()
    if status.standing is Standing.RUNNING:
        row.operator("sacha.stop_training", icon="CANCEL").model = model
    elif status.standing in {Standing.STOPPED, Standing.FAILED}:
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("sacha.continue_training", icon="PLAY").model = model
    elif status.standing is Standing.FINISHED:
        row.operator("sacha.open", text="Open Avatar", icon="IMPORT").filepath = model
    row.operator("wm.path_open", text="Show Folder", icon="FILE_FOLDER").filepath = model


CLASSES = (SachaTrainingPanel,)
