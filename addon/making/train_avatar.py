# SPDX-License-Identifier: GPL-3.0-or-later
"""Training: from a dataset to an avatar, in a process that Blender's end does not end."""

from __future__ import annotations

import json
import time
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from .. import engine, preferences, problem, running, sources
from . import known_runs, run_folder, run_status
from .run_status import Standing
from .settings import DEVICES, VARIANTS
from .training_list import run_of

__all__ = ["CLASSES"]

TICK_S = 0.2  # how often a waiting script looks
TRANSFORMS = "transforms_train.json"  # what makes a folder a dataset
AS_SET_UP = "; as set up in the scene where not given"


class SachaTrain(bpy.types.Operator):
    """Train an avatar on a dataset."""

    bl_idname = "sacha.train"
    bl_label = "Train"
    bl_description = (
        "Train an avatar on the dataset; goes on when Blender is closed, and where an interrupted training stopped"
    )

    dataset: StringProperty(name="Dataset", description=f"Folder of the capture{AS_SET_UP}", subtype="DIR_PATH")
    model: StringProperty(name="Model", description=f"Folder that the avatar goes to{AS_SET_UP}", subtype="DIR_PATH")
    variant: EnumProperty(name="Variant", description=f"How Gaussians are grown and pruned{AS_SET_UP}", items=VARIANTS)
    iterations: IntProperty(name="Iterations", description=f"Length of the training{AS_SET_UP}", min=1)
    shrink: IntProperty(name="Shrink Images", description=f"How many times smaller than stored{AS_SET_UP}", min=1)
    seed: IntProperty(name="Seed", description=f"Of everything random{AS_SET_UP}", min=0)
    device: EnumProperty(name="Device", description=f"Where to compute{AS_SET_UP}", items=DEVICES)
    finetune: BoolProperty(name="Write File", description=f"Write level-N.sacha after training{AS_SET_UP}")
    restart: BoolProperty(
        name="Restart", description="Begin anew, even where an interrupted training could go on", options={"SKIP_SAVE"}
    )
    wait: running.wait_property()

    invoke = running.invoke

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the training; a script that waits gets its end, too."""
        try:
            arguments, model = _arguments(self, context)
            run = _start(context, arguments, model)
        except (engine.EngineMissingError, OSError, ValueError) as error:
            return problem.tell(self, str(error), getattr(error, "kind", ""))
        if not self.wait:
            self.report({"INFO"}, f"Training goes on in {model}, also when Blender is closed")
            return {"FINISHED"}
        return _see_through(self, run)


class SachaContinueTraining(bpy.types.Operator):
    """Let a training that was interrupted go on where it was."""

    bl_idname = "sacha.continue_training"
    bl_label = "Go On"
    bl_description = "Let the training go on where it was interrupted"

    model: StringProperty(name="Model", description="Its folder", subtype="DIR_PATH", options={"SKIP_SAVE"})
    wait: running.wait_property()

    invoke = running.invoke

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start it again with what it was started with."""
        try:
            run = run_of(self.model)
            arguments = [argument for argument in run.arguments if argument != "--restart"]
            run = _start(context, arguments, run.model)
        except (engine.EngineMissingError, OSError, ValueError) as error:
            return problem.tell(self, str(error), getattr(error, "kind", ""))
        return _see_through(self, run) if self.wait else {"FINISHED"}


def _arguments(given: SachaTrain, context: bpy.types.Context) -> tuple[list[str], Path]:
    """Give the engine's arguments, and the folder of the model.

    Raises:
        ValueError: a folder is not named, or the dataset is none.
    """
    setup = context.scene.sacha_making

    def chosen(name: str) -> str | int | bool:
        return getattr(given if given.properties.is_property_set(name) else setup, name)

    for name in ("dataset", "model"):
        if not chosen(name):
            raise ValueError(f"No {name}: name the folder {'of the capture' if name == 'dataset' else 'it goes to'}")
    dataset, model = sources.full_path(chosen("dataset")), sources.full_path(chosen("model"))
    arguments = ["train", str(dataset), "-o", str(model), *sources.head_options(context)]
    arguments += ["--variant", chosen("variant"), "--iterations", str(chosen("iterations"))]
    arguments += ["--seed", str(chosen("seed")), "--device", chosen("device")]
    stored = _stored_size(dataset)
    if chosen("shrink") > 1:
        width, height = (max(side // chosen("shrink"), 1) for side in stored)
        arguments += ["--width", str(width), "--height", str(height)]
    if chosen("finetune"):
        arguments += ["--finetune-level", str(context.scene.sacha.level)]
    return arguments + ["--restart"] * given.restart, model


def _stored_size(dataset: Path) -> tuple[int, int]:
    """Give width and height of a dataset's pictures.

    Raises:
        ValueError: the folder is no dataset.
    """
    places = [dataset, *sorted(dataset.glob("UNION*"))]
    found = next((place / TRANSFORMS for place in places if (place / TRANSFORMS).is_file()), None)
    if found is None:
        raise ValueError(f"{dataset} is no dataset: it has no {TRANSFORMS}, as GaussianAvatars' captures do")
    try:
        told = json.loads(found.read_text(encoding="utf-8"))
        told = told if "w" in told else told["frames"][0]
        return int(told["w"]), int(told["h"])
    except (ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{found} is damaged: it does not say how large the pictures are") from error


def _start(context: bpy.types.Context, arguments: list[str], model: Path) -> run_folder.Run:
    python = preferences.engine_python(context)
    run = run_folder.start_run([str(python), "-m", "sacha_core"], arguments, model)
    known_runs.remember(run)
    return run


def _see_through(operator: bpy.types.Operator, run: run_folder.Run) -> set[str]:
    """Wait for the end of a training; where this is interrupted the training is not."""
    while (status := run_status.look(run_folder.find_run(run.model) or run)).goes_on:
        time.sleep(TICK_S)
    known_runs.refresh()
    if status.standing is Standing.FINISHED:
        operator.report({"INFO"}, f"Trained {run.model.name}")
        return {"FINISHED"}
    if status.standing is Standing.STOPPED:
        operator.report({"WARNING"}, status.complaint.message)
        return {"CANCELLED"}
    return problem.tell(operator, status.complaint.message, status.complaint.kind, log="\n".join(status.log))


CLASSES = (SachaTrain, SachaContinueTraining)
