"""With a window: the job runs beside the user's work. Blender here has no events, so the test is the event loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
import pytest
from conftest import Material

LIMIT_S = 30.0  # far more than the engine takes to open the material
TIMER = SimpleNamespace(type="TIMER")
MOUSE = SimpleNamespace(type="MOUSEMOVE")


@pytest.fixture
def running(addon: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The add-on's way of running jobs, made to believe that events come."""
    module = __import__(f"{addon.__name__}.running", fromlist=["execute"])
    monkeypatch.setattr(module, "events_come", lambda: True)
    yield module
    module.end_now()


@pytest.fixture
def slow_engine(preferences: bpy.types.AddonPreferences, tmp_path: Path) -> Path:
    """An engine that says one line of progress and then takes for ever."""
    engine = tmp_path / "slow-engine"
    engine.write_text('#!/bin/sh\necho \'{"stage": "fit", "done": 1, "total": 4}\'\nexec sleep 60\n')
    engine.chmod(0o755)
    preferences.engine_python = str(engine)
    return engine


def start(**options: str) -> bpy.types.Operator:
    """Start opening a file as a window does, and give the operator that Blender keeps for its events."""
    assert bpy.ops.sacha.open("EXEC_DEFAULT", wait=False, **options) == {"RUNNING_MODAL"}
    return bpy.context.window.modal_operators[0]


def tick_until(operator: bpy.types.Operator, condition: Callable[[], bool]) -> set[str]:
    """Send timer events until the condition holds; give the operator's last answer."""
    end = time.monotonic() + LIMIT_S
    while True:
        answer = type(operator).modal(operator, bpy.context, TIMER)
        if condition() or answer != {"PASS_THROUGH"}:
            return answer
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def test_the_window_is_free_while_the_engine_works_and_then_has_the_mesh(
    running: ModuleType, material: Material
) -> None:
    operator = start(filepath=str(material.folder / "avatar.sacha"))
    assert running.now().work.title == "Opening avatar.sacha"
    assert type(operator).modal(operator, bpy.context, MOUSE) == {"PASS_THROUGH"}  # the mouse is not ours
    assert not bpy.data.objects
    assert tick_until(operator, lambda: False) == {"FINISHED"}
    assert bpy.context.object.data.sacha.kind == "avatar"
    assert running.now() is None


def test_progress_is_shown_and_cancel_ends_the_worker(running: ModuleType, slow_engine: Path) -> None:
    operator = start(filepath="/any.sacha")
    job = running.now().job
    tick_until(operator, lambda: job.stage == "fit")
    assert job.fraction == 0.25
    assert bpy.ops.sacha.cancel.poll()
    bpy.ops.sacha.cancel()
    assert tick_until(operator, lambda: False) == {"CANCELLED"}
    assert job.process.poll() is not None
    assert not job.folder.exists()
    assert not bpy.ops.sacha.cancel.poll()


def test_a_second_command_is_told_to_wait(running: ModuleType, slow_engine: Path) -> None:
    start(filepath="/any.sacha")
    with pytest.raises(RuntimeError, match=r"Still busy: Opening any\.sacha"):
        bpy.ops.sacha.open(filepath="/other.sacha")


def test_closing_the_file_or_blender_ends_the_worker(running: ModuleType, slow_engine: Path) -> None:
    start(filepath="/any.sacha")
    job = running.now().job
    bpy.ops.wm.read_homefile(use_empty=True)
    assert running.now() is None
    assert job.process.poll() is not None
    assert not job.folder.exists()


def test_disabling_the_addon_ends_the_worker(running: ModuleType, slow_engine: Path, addon: ModuleType) -> None:
    start(filepath="/any.sacha")
    job = running.now().job
    addon.unregister()
    try:
        assert job.process.poll() is not None
        assert not job.folder.exists()
    finally:
        addon.register()
