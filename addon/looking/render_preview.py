# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview: what the engine draws of the avatar, as it stands now, from the scene's camera; and how far that is from the original."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty
from mathutils import Color

from .. import engine, preferences, running, sources
from ..job import Job
from . import pictures
from .camera import camera_file
from .posed_head import save_vertices, source_of
from .settings import ERRORS, LEVELS

__all__ = ["CLASSES"]


class SachaRenderPreview(bpy.types.Operator):
    """Draw the active avatar as it stands, from the scene's camera, into the image SACHA Preview."""

    bl_idname = "sacha.render_preview"
    bl_label = "Render Preview"
    bl_description = (
        "Let the engine draw the avatar in its present pose from the scene's camera, decoded at the chosen level"
    )

    level: EnumProperty(
        name="Decoded At", description="Where not given, the scene's", items=LEVELS, options={"SKIP_SAVE"}
    )
    error: EnumProperty(name="Error", description="Where not given, the scene's", items=ERRORS, options={"SKIP_SAVE"})
    against: StringProperty(
        name="Compare With", description="Where not given, the scene's", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    wait: running.wait_property()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """A scene without a camera has no view to draw."""
        if context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def work(self, context: bpy.types.Context) -> running.Work:
        """Let the engine draw, then take its pictures over."""
        head, source = source_of(context)
        python, scene = preferences.engine_python(context), context.scene
        compared = self._compared(context, source)
        given = [*compared, *sources.head_options(context)]
        depsgraph = context.evaluated_depsgraph_get()
        size = tuple(
            max(round(side * scene.render.resolution_percentage / 100), 1)
            for side in (scene.render.resolution_x, scene.render.resolution_y)
        )
        aspect = scene.render.pixel_aspect_x, scene.render.pixel_aspect_y
        view = camera_file(scene.camera, depsgraph, *size, aspect, head.matrix_world)

        def command(folder: Path) -> list[str]:
            save_vertices(head, depsgraph, folder / "vertices.npy")
            (folder / "camera.json").write_text(json.dumps(view), encoding="utf-8")
            files = ["--vertices", "vertices.npy", "--camera-file", "camera.json", "-o", "preview.png"]
            options = [*files, "--json", "report.json", *given]  # in the job's folder, where the engine works
            return engine.command(python, "render", source, *options)

        def finish(job: Job) -> str:
            return _take_over(context, job.folder)

        return running.Work(f"Drawing {source.name}", command, finish)

    invoke = running.invoke
    execute = running.execute
    modal = running.modal
    cancel = running.cancel

    def _compared(self, context: bpy.types.Context, source: Path) -> list[str | Path]:
        """Give the engine's options of what is drawn, and of what it is compared with.

        Raises:
            ValueError: an error was asked for and there is nothing to compare with.
        """
        chosen = context.scene.sacha_looking
        level, error, against = (
            getattr(self if self.properties.is_property_set(name) else chosen, name)
            for name in ("level", "error", "against")
        )
        options: list[str | Path] = []
        if level != "FILE":
            options += ["--level", level, "--encoded", _kept(source, level)]
        if against:
            options += ["--against", sources.full_path(against)]
        if not options or (level == "FILE" and not against):
            if error != "NONE" and self.properties.is_property_set("error"):
                raise ValueError("Nothing to compare with: choose a level, or name the uncompressed avatar")
            return options
        options += ["--truth", "truth.png"]
        if error != "NONE":
            brightest = chosen.brightest_flip if error == "FLIP" else chosen.brightest
            options += ["--error", "error.png", "--error-kind", error.lower(), "--brightest", f"{brightest:.6g}"]
        return options


def _kept(source: Path, level: str) -> Path:
    """Give where this Blender keeps the file of a level while it runs, so that the next preview need not encode again."""
    told = hashlib.sha256(f"{source}\n{level}".encode()).hexdigest()[:16]
    return Path(bpy.app.tempdir) / f"sacha-level-{told}.sacha"


def _take_over(context: bpy.types.Context, folder: Path) -> str:
    """Make the engine's pictures images, and say what it measured."""
    told = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    for name, file in ((pictures.TRUTH, "truth.png"), (pictures.ERROR, "error.png"), (pictures.PREVIEW, "preview.png")):
        if (folder / file).exists():
            image = pictures.take(name, folder / file)
        else:  # an error of an earlier picture would be taken for one of this
            pictures.remove(name)
    pictures.show(context, image)
    context.scene.sacha_looking.told = measured = _measured(told)
    _explain(context.scene.sacha_looking.legend, told.get("legend", []))
    return f"Drew {told['width']} x {told['height']} pixels, {told['n_gaussians']:,} Gaussians. {measured}".strip()


def _explain(legend: bpy.types.bpy_prop_collection, told: list[dict[str, Any]]) -> None:
    """Keep what the colours of a picture of an error mean."""
    legend.clear()
    for number, entry in enumerate(told, start=1):
        line = legend.add()
        line.name = f"{entry['error']:.3g}" + " and more" * (number == len(told))
        line.kept = Color([byte / 255 for byte in entry["colour"]]).from_srgb_to_scene_linear()


def _measured(told: dict[str, Any]) -> str:
    """Say in a line how near a preview is to the uncompressed avatar; empty where nothing was compared."""
    size = f"{told['bytes'] / 1000:,.1f} KB, " if told.get("bytes") else ""
    if "identical" not in told:
        return ""
    if told["identical"]:
        return f"{size}the same picture"
    own = told["own_psnr_db"]
    return f"{size}{told['psnr_db']:.1f} dB" + (f", {own:.1f} dB on the avatar" if own is not None else "")


CLASSES = (SachaRenderPreview,)
