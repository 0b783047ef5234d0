# SPDX-License-Identifier: GPL-3.0-or-later
"""What somebody who helps would ask for, as text: versions, paths, settings, what is shown, and what went wrong."""

from __future__ import annotations

import os
import platform
import sys
import tomllib
from pathlib import Path

import bpy
import numpy as np

from .. import engine, preferences, problem, running
from ..seeing.shown import shown_by

__all__ = ["report"]

ADDON = __package__.rpartition(".")[0]
OURS = "SACHA_"  # environment variables that change what we do
SETTINGS = ("head", "masks", "motion", "level")


def report(context: bpy.types.Context, asked: str) -> str:
    """Write everything down.

    Args:
        context: Blender's.
        asked: what the engine said when it was asked what it has, or why it could not be asked.

    Returns:
        Lines of text; the user's home folder is written as ~, since the text will be sent to others.
    """
    sections = {
        "Add-on": _addon(),
        "Blender": _blender(context),
        "Engine": [f"named: {_named_engine(context)}", f"asked: {asked}", f"the add-on speaks: {engine.SPEAKS}"],
        "Environment": [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(OURS)],
        "Scene": [f"{name}: {getattr(context.scene.sacha, name)}" for name in SETTINGS],
        "Active object": _active(context),
        "Running": _running(),
        "Last problem": _problem(),
    }
    text = "\n\n".join(
        "\n".join([title, *(f"  {line}" for line in lines or ["nothing"])]) for title, lines in sections.items()
    )
    return _without_home(f"SACHA diagnostics\n\n{text}\n")


def _addon() -> list[str]:
    folder = Path(__file__).parents[1]
    manifest = tomllib.loads((folder / "blender_manifest.toml").read_text(encoding="utf-8"))
    return [f"version: {manifest['version']}", f"module: {ADDON}", f"folder: {folder}"]


def _blender(context: bpy.types.Context) -> list[str]:
    app = bpy.app
    hashed = app.build_hash.decode(errors="replace")
    lines = [
        f"version: {app.version_string} ({hashed})",
        f"platform: {platform.platform()}",
        f"Python: {platform.python_version()}, NumPy {np.__version__}",
        f"executable: {app.binary_path or sys.executable}",
        f"background: {app.background}",
        f"render engine: {context.scene.render.engine}",
    ]
    return lines if app.background else [*lines, f"graphics: {_graphics()}"]


def _graphics() -> str:
    import gpu  # noqa: PLC0415  (needs a window)

    return f"{gpu.platform.vendor_get()} {gpu.platform.renderer_get()} {gpu.platform.version_get()}"


def _named_engine(context: bpy.types.Context) -> str:
    try:
        return str(preferences.engine_python(context))
    except engine.EngineMissingError as error:
        return str(error)


def _active(context: bpy.types.Context) -> list[str]:
    shown = shown_by(context)
    if shown is None:
        return []
    mesh = context.object.data
    attributes = ", ".join(f"{one.name} ({one.domain}, {len(one.data)})" for one in mesh.attributes)
    return [
        f"kind: {shown.kind}",
        f"source: {shown.source}",
        f"head: {shown.head}",
        f"mesh: {len(mesh.vertices)} vertices, {len(mesh.polygons)} faces, {mesh.users} users",
        f"attributes: {attributes}",
        *(fact.name for fact in shown.facts),
    ]


def _running() -> list[str]:
    now = running.now()
    return [] if now is None else [f"{now.work.title}: {now.job.stage} {now.job.done}/{now.job.total}"]


def _problem() -> list[str]:
    wrong = problem.last()
    if wrong is None:
        return []
    log = ["log:", *(f"  {line}" for line in wrong.log.splitlines())] if wrong.log else []
    return [f"at: {wrong.at}", f"doing: {wrong.title}", f"kind: {wrong.kind or 'none'}", wrong.message, *log]


def _without_home(text: str) -> str:
    home = os.path.expanduser("~")  # noqa: PTH111  (Path.home raises where there is none)
    return text.replace(home, "~") if len(home) > 1 else text
