# SPDX-License-Identifier: GPL-3.0-or-later
"""The trainings that were started on this machine: remembered with the user's own files, looked at now and then, shown in the sidebar."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy

from . import run_folder, run_status
from .run_folder import Run
from .run_status import Status

__all__ = ["CLASSES", "attach", "detach", "forget", "refresh", "remember", "shown"]

TICK_S = 1.0  # how often a window looks at trainings that go on
MOST_SHOWN = 8  # the newest ones
FOLDER = "sacha_runs"
CLASSES = ()

_seen: list[Status] = []  # what the last look found, newest first


def shown() -> list[Status]:
    """Give what the last look found, newest first; looks at no file, so that panels may ask at each drawing."""
    return _seen


def remember(run: Run) -> None:
    """Keep in mind where a training lies, and watch it."""
    _entry(run.model).write_text(str(run.model), encoding="utf-8")
    refresh()
    _watch()


def forget(model: Path) -> None:
    """Do not show a training any more; its folder stays as it is."""
    _entry(model).unlink(missing_ok=True)
    refresh()


def refresh() -> list[Status]:
    """Look at all trainings that are remembered; those whose folder is gone are forgotten."""
    found = []
    for entry in _memory().glob("*.txt"):
        run = run_folder.find_run(Path(entry.read_text(encoding="utf-8")))
        if run is None:
            entry.unlink(missing_ok=True)
        else:
            found.append(run)
    newest = sorted(found, key=lambda run: run.started_s, reverse=True)[:MOST_SHOWN]
    _seen[:] = [run_status.look(run) for run in newest]
    return _seen


def attach() -> None:
    """Find again what was going on when Blender was closed last."""
    if not bpy.app.background:
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)


def detach() -> None:
    """Watch no longer: a timer that outlives the window can keep Blender alive for ever."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _watch() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)


def _tick() -> float | None:
    """Look, and draw what was found; comes again as long as anything goes on."""
    refresh()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
    return TICK_S if any(status.goes_on for status in _seen) else None


def _memory() -> Path:
    """Give the folder where trainings are remembered, one small file for each."""
    return Path(bpy.utils.user_resource("CONFIG", path=FOLDER, create=True))


def _entry(model: Path) -> Path:
    return _memory() / f"{hashlib.sha256(str(model).encode()).hexdigest()[:16]}.txt"
