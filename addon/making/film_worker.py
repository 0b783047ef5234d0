# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs in a Blender without a window: films a copy of the scene and lets the engine make a dataset of it.

Usage: film_worker.py FILM.json; what it holds is what `film_head.film_settings` gives.
"""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import bpy

DRAWN = {
    "MESH",
    "CURVE",
    "CURVES",
    "SURFACE",
    "META",
    "FONT",
    "VOLUME",
    "POINTCLOUD",
    "GPENCIL",
    "GREASEPENCIL",
    "EMPTY",
}
ORPHANED = "The Blender that asked for it is gone"


class FilmError(Exception):
    """The film cannot be made; the message is for the user."""


def say(line: dict[str, Any]) -> None:
    """Say one thing to the Blender that waits."""
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def film(told: dict[str, Any]) -> None:
    """Do everything.

    Raises:
        FilmError: the scene cannot be filmed.
        ValueError: the head's controls or a camera cannot be said in the engine's terms.
    """
    package = told["package"]
    if not hasattr(bpy.types.Scene, "sacha_making"):  # the user's preferences enable it, unless this is the module bpy
        bpy.ops.preferences.addon_enable(module=package)
    measuring = importlib.import_module(f"{package}.making.film_measure")
    processes = importlib.import_module(f"{package}.processes")
    bpy.ops.wm.open_mainfile(filepath=told["blend"], load_ui=False, use_scripts=told["scripts"])
    scene = bpy.data.scenes[told["scene"]]
    bpy.context.window.scene = scene
    footage = Path(told["footage"])
    start_footage(footage, told["resume"])
    prepare(scene, told)
    views = measuring.measure(scene, told, footage, say)
    engine(told, "--check")
    take_pictures(scene, told, footage, views, processes)
    engine(told, "--json", told["report"])
    clear(footage)


def start_footage(footage: Path, resume: bool) -> None:
    """Make the folder of the footage; one that is there must be one of these, and is emptied unless it shall be used.

    Raises:
        FilmError: the folder holds something else.
    """
    if footage.exists() and not resume:
        clear(footage)
        if footage.exists():
            raise FilmError(f"{footage} holds files that are no footage: choose another folder, or move them away")
    footage.mkdir(parents=True, exist_ok=True)


def clear(footage: Path) -> None:
    """Remove footage, and its folder if nothing else is in it."""
    for pattern in ("?????_*.png", "footage.json", "flame_param.npz", "posed.npy", "unposed.npy"):
        for path in footage.glob(pattern):
            path.unlink()
    if not any(footage.iterdir()):
        footage.rmdir()


def prepare(scene: bpy.types.Scene, told: dict[str, Any]) -> None:
    """Set the scene up so that pictures are as a pinhole camera sees them, with alpha."""
    render = scene.render
    render.engine = told["renderer"]
    render.resolution_x, render.resolution_y, render.resolution_percentage = told["width"], told["height"], 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.film_transparent, render.dither_intensity = True, 0.0
    for switch in ("use_border", "use_compositing", "use_sequencer", "use_motion_blur", "use_multiview", "use_stamp"):
        setattr(render, switch, False)
    render.use_persistent_data = True
    if hasattr(render.image_settings, "media_type"):  # from 5.0 on
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGBA"
    render.image_settings.color_depth, render.image_settings.compression = "8", 15
    if told["renderer"] == "CYCLES":
        scene.cycles.samples = told["samples"]
        if not importlib.import_module("_cycles").with_openimagedenoise:  # then asking for it is an error
            scene.cycles.use_denoising = False
    for name in told["cameras"]:
        bpy.data.objects[name].data.dof.use_dof = False
    if told["kept"]:
        for thing in scene.objects:
            if thing.type in DRAWN and thing.name not in told["kept"]:
                thing.hide_render = True


def take_pictures(
    scene: bpy.types.Scene, told: dict[str, Any], footage: Path, views: list[dict[str, Any]], processes: Any
) -> None:
    """Render what is not there yet.

    Raises:
        FilmError: the Blender that asked for it is gone.
    """
    begun_s = time.monotonic()
    waiting = None if told["blender"] is None else processes.Process(*told["blender"])
    missing = [view for view in views if not (footage / view["file"]).exists()]
    for made, view in enumerate(missing, start=1):
        if waiting is not None and not waiting.lives():
            raise FilmError(ORPHANED)
        if scene.frame_current != told["frames"][view["timestep"]]:
            scene.frame_set(told["frames"][view["timestep"]])
        scene.camera = scene.objects[told["cameras"][view["camera_index"]]]
        part = footage / f".part_{view['file']}"
        scene.render.filepath = str(part)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        part.replace(footage / view["file"])
        left_s = (time.monotonic() - begun_s) / made * (len(missing) - made)
        say({"stage": "film", "done": len(views) - len(missing) + made, "total": len(views), "seconds_left": left_s})


def engine(told: dict[str, Any], *more: str) -> None:
    """Let the engine check the footage, or make a dataset of it; its progress and its complaints go where ours go."""
    given = ["assemble", told["footage"], "--source", told["source"], "-o", told["root"], *told["options"], *more]
    done = subprocess.run(  # noqa: S603  (the engine that the user named)
        [told["python"], "-m", "sacha_core", *given, "--progress", "json"], check=False, stdin=subprocess.DEVNULL
    )
    if done.returncode:
        sys.exit(done.returncode)


def main(arguments: list[str]) -> None:
    """Film, or say in one line why not."""
    given = arguments[arguments.index("--") + 1 :] if "--" in arguments else arguments[1:]
    try:
        film(json.loads(Path(given[0]).read_text(encoding="utf-8")))
        say(
            {"finished": True}
        )  # the last act of ours: Blenders crash while they close (the module bpy 4.2 always does)
    except (FilmError, ValueError, RuntimeError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]  # of an operator: all its traceback
        say({"error": {"kind": "", "message": lines[-1] if lines else type(error).__name__}})
        sys.exit(2)


if __name__ == "__main__":
    main(sys.argv)
