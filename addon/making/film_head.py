# SPDX-License-Identifier: GPL-3.0-or-later
"""Filming: pictures of an animated head from many cameras, as a dataset that avatars are trained on.

A second Blender without a window renders a copy of the scene (`film_worker.py`), so that this one stays free.
"""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from .. import preferences, processes, running, sources
from ..job import Job
from ..remembered import remember
from .heads import cameras_of, head_of

__all__ = ["CLASSES"]

FEWEST_CAMERAS = 2  # one of them is held out to judge by
LONGEST_S = 30 * 86_400.0  # a month: filming takes as long as it takes, and can be cancelled
WORKER = Path(__file__).with_name("film_worker.py")


class SachaFilm(bpy.types.Operator):
    """Film the active head, over the scene's frames and from its cameras, as a dataset to train on."""

    bl_idname = "sacha.film"
    bl_label = "Film Dataset"
    bl_description = "Film the active head, over the scene's frames and from its cameras, as a dataset to train on"

    directory: StringProperty(
        name="Dataset",
        description="Folder that the dataset goes to; as set up in the scene where not given",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )
    take: StringProperty(
        name="Take", description="Name of this performance, a part of the folder's name", default="TAKE-1"
    )
    resume: BoolProperty(
        name="Go On",
        description="Keep the pictures that an interrupted filming left; right only where nothing in the scene has changed since",
        options={"SKIP_SAVE"},
    )
    wait: running.wait_property()

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let a second Blender film a copy of the scene, and the engine make a dataset of it."""
        settings = film_settings(self, context)
        filmed, program = remember(context.scene), blender_program()

        def command(folder: Path) -> list[str]:
            copy = folder / "scene.blend"
            try:
                bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True, check_existing=False)
            except RuntimeError as error:
                raise ValueError(f"The scene cannot be copied for filming: {error}") from error
            told = folder / "film.json"
            report = folder / "report.json"
            told.write_text(json.dumps(settings | {"blend": str(copy), "report": str(report)}), encoding="utf-8")
            return [*program, str(told)]

        def finish(job: Job) -> str:
            told, wanted = job.report(), len(settings["frames"]) * len(settings["cameras"])
            if told["n_images"] != wanted or not Path(told["capture"]).is_dir():
                raise ValueError(f"{told['capture']} has {told['n_images']:,} of {wanted:,} pictures: film it again")
            done = f"Filmed {wanted:,} pictures of {told['n_timesteps']:,} timesteps to {told['capture']}"
            scene = filmed.find()
            if scene is not None:
                scene.sacha_making.dataset = told["capture"]
            crashed = job.aftermath()
            return (
                f"{done}. All was written when the Blender that filmed crashed at its end ({crashed})"
                if crashed
                else done
            )

        return running.Work(f"Filming {settings['head']}", command, finish, LONGEST_S)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel


def blender_program() -> list[str]:
    """Give the program and arguments that run the worker in a Blender without a window: this one, or this module's Python."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "--background", "--python-exit-code", "1", "--python", str(WORKER), "--"]
    return [sys.executable, str(WORKER)]


def film_settings(given: SachaFilm, context: bpy.types.Context) -> dict:
    """Give all that the worker needs to know, as plain values.

    Raises:
        ValueError: something is missing; says what.
        EngineMissingError: there is no engine to make the dataset.
    """
    scene, setup, head = context.scene, context.scene.sacha_making, head_of(context)
    cameras = cameras_of(scene)
    if len(cameras) < FEWEST_CAMERAS:
        raise ValueError(
            f"{len(cameras)} camera{'s' * (len(cameras) != 1)} to film from: Add Cameras makes a set of them"
        )
    folder = given.directory or setup.film_folder
    if not folder:
        raise ValueError("No dataset: name the folder that it goes to")
    root = sources.full_path(folder)
    frames = list(range(scene.frame_start, scene.frame_end + 1, setup.frame_step))
    blender = processes.find_process(os.getpid())
    kept = {*context.selected_objects, head} if setup.only_selected else set()
    return {
        "package": __package__.rpartition(".")[0],
        "blender": None if blender is None else [blender.number, blender.born],
        "python": str(preferences.engine_python(context)),
        "source": str(sources.full_path(head.data.sacha.source)),
        "options": sources.head_options(context),
        "root": str(root),
        "footage": str(root / "footage"),
        "resume": given.resume,
        "scripts": not bpy.app.autoexec_fail,
        "scene": scene.name,
        "head": head.name,
        "cameras": [camera.name for camera in cameras],
        "kept": sorted(thing.name for thing in kept),
        "subject": plain_name(head.data.sacha.head or head.name),
        "take": plain_name(given.take),
        "frames": frames,
        "frame_rate": scene.render.fps / scene.render.fps_base / setup.frame_step,
        "renderer": setup.renderer,
        "samples": setup.samples,
        "width": setup.width,
        "height": setup.height,
    }


def plain_name(name: str) -> str:
    """Give a name as it may stand in a folder's name."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", name).strip("-.") or "head"


CLASSES = (SachaFilm,)
