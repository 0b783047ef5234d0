"""Take screenshots of the add-on's panels; run by `tools/screenshots.py` in a Blender with a window.

Events come only between the steps of a timer, so that each step does one thing and the next one sees it drawn.
"""

from __future__ import annotations

import os
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import bpy

HERE = Path(__file__).parent
sys.path.append(str(HERE))

from run import ENGINE, install  # noqa: E402  (it lies beside this file)

PAUSE_S = 0.7  # between steps: time to draw
FOLDER, *GIVEN = sys.argv[sys.argv.index("--") + 1 :]
SIZE = (1600, 1200)  # of the window, pixels
WIDER = 200  # pixels that the sidebar gets
OPEN = {"SACHA_PT_main"}  # panels that stay open whatever is photographed


def only_ours() -> None:
    """Take all other panels off the sidebar, since no script can choose a tab."""
    for name in dir(bpy.types):
        kind = getattr(bpy.types, name)
        ours = name.startswith("SACHA_")
        if not ours and getattr(kind, "bl_space_type", "") == "VIEW_3D" and getattr(kind, "bl_region_type", "") == "UI":
            bpy.utils.unregister_class(kind)


def open_only(*names: str) -> None:
    """Open some of our panels and leave the others out."""
    for name, panel in reversed(PANELS.items()):
        if hasattr(bpy.types, name):
            bpy.utils.unregister_class(panel)
    for name, panel in PANELS.items():
        if name in OPEN or any(name.startswith(one) for one in names):
            panel.bl_options = set(getattr(panel, "bl_options", set())) - {"DEFAULT_CLOSED"}
            bpy.utils.register_class(panel)


def avatar() -> list[str]:
    """Give what is opened: what was named, or an avatar of the synthetic head."""
    if GIVEN:
        return GIVEN
    folder = Path(FOLDER) / "material"
    folder.mkdir(exist_ok=True)
    subprocess.run([ENGINE, str(HERE / "make_large.py"), str(folder)], check=True, stdin=subprocess.DEVNULL)
    return [str(folder / "large.sacha")]


def start() -> None:
    """Open the avatar, and look at it from the front."""
    for one in list(bpy.data.objects):
        bpy.data.objects.remove(one)
    source, *heads = avatar()
    for name, path in zip(("head", "masks"), heads, strict=False):
        setattr(bpy.context.scene.sacha, name, path)
    bpy.ops.sacha.open(filepath=source)


def look() -> None:
    """Fill the view with the head, without what Blender draws over it."""
    space = bpy.context.space_data
    space.show_region_ui, space.show_region_toolbar = True, False
    space.overlay.show_floor = space.overlay.show_axis_x = space.overlay.show_axis_y = False
    space.overlay.show_cursor = space.overlay.show_outline_selected = space.overlay.show_bones = False
    space.shading.light = "FLAT"
    bpy.ops.view3d.view_axis(type="FRONT")
    bpy.ops.view3d.view_selected()
    bpy.ops.screen.screen_full_area()


def choose_tab() -> None:
    """Click on our tab of the sidebar, the second one: no script can choose it."""
    point(SIZE[0] - 14, 156, "click", "1")


def widen() -> None:
    """Drag the sidebar's edge as a hand does, while Blender goes on."""
    edge = next(one for one in bpy.context.area.regions if one.type == "UI").x + 1
    way = [f"mousemove {x} 700 sleep 0.1" for x in (edge + 5, edge, edge)] + ["mousedown 1 sleep 0.3"]
    way += [f"mousemove {x} 700 sleep 0.1" for x in range(edge, edge - WIDER, -25)]
    subprocess.Popen(["xdotool", *" ".join([*way, "mouseup 1 mousemove 300 900"]).split()], stdin=subprocess.DEVNULL)


def point(x: int, y: int, *more: str) -> None:
    """Move the mouse, and press it."""
    subprocess.run(["xdotool", "mousemove", str(x), str(y), *more], check=True, stdin=subprocess.DEVNULL)


def take(name: str) -> Callable[[], None]:
    """Make a step that takes a screenshot, of the whole display: what Blender itself reads of its window is black with some drivers."""
    command = ["import", "-window", "root", str(Path(FOLDER) / f"{name}.png")]
    return lambda: subprocess.run(command, check=True, stdin=subprocess.DEVNULL)


def show(view: str) -> Callable[[], None]:
    """Make a step that switches the view, where there is such a view."""

    def step() -> None:
        if view.lower() in {one.name for one in bpy.context.object.data.sacha.views}:
            bpy.context.object.data.sacha.view = view

    return step


def fail() -> None:
    """Meet a problem, so that there is one to show."""
    path = Path(FOLDER) / "letter.sacha"
    path.write_bytes(b"Dear Sir or Madam")
    try:
        bpy.ops.sacha.open(filepath=str(path))
    except RuntimeError as error:
        print(error)  # noqa: T201


def favour() -> None:
    """Raise the mouth's weight."""
    regions = bpy.context.object.data.sacha_steering.regions
    if "mouth" in regions:
        regions["mouth"].weight = 2.0


def spend() -> None:
    """Apply the budget, so that there is an outcome."""
    asked = bpy.context.object.data.sacha_steering
    asked.limit, asked.views, asked.regions["neck"].highest_share = "SHARE", 16, 10.0
    bpy.ops.sacha.apply_budget(filepath=str(Path(FOLDER) / "steered.sacha"))


def rest() -> None:
    """Let Blender draw, and the mouse move."""


def forget_engine() -> None:
    """Have no engine."""
    preferences().engine_python = "/nowhere/python"


def preferences() -> bpy.types.AddonPreferences:
    """Give ours."""
    return bpy.context.preferences.addons[MODULE].preferences


STEPS: list[Callable[[], object]] = [
    start, look, choose_tab, widen, *[rest] * 4,
    lambda: open_only("SACHA_PT_shown", "SACHA_PT_regions"), take("seeing_region"),
    show("COUNT"), take("seeing_count"), show("BYTES"), take("seeing_bytes"),
    favour, spend, lambda: open_only("SACHA_PT_budget", "SACHA_PT_outcome"), take("steering"),
    lambda: open_only("SACHA_PT_look", "SACHA_PT_preview"), take("looking"),
    lambda: open_only("SACHA_PT_files", "SACHA_PT_training", "SACHA_PT_film"), take("making"),
    lambda: open_only("SACHA_PT_controls"), take("controls"),
    fail, lambda: open_only("SACHA_PT_help"), take("problem"),
    forget_engine, rest, take("no_engine"),
]  # fmt: skip


def tick() -> float | None:
    """Take the next step; end Blender after the last, or after one that went wrong."""
    window = bpy.context.window_manager.windows[0]
    area = next(one for one in window.screen.areas if one.type == "VIEW_3D")
    region = next(one for one in area.regions if one.type == "WINDOW")
    try:
        with bpy.context.temp_override(window=window, area=area, region=region):
            STEPS.pop(0)()
    except Exception:  # noqa: BLE001  (a window would stay open for ever)
        traceback.print_exc()
        os._exit(1)
    if not STEPS:
        os._exit(0)
    for one in window.screen.areas:
        one.tag_redraw()
    return PAUSE_S


bpy.context.preferences.view.show_splash = False
MODULE = install()
preferences().engine_python = ENGINE
ours = [name for name in dir(bpy.types) if name.startswith("SACHA_PT_")]
# Kept, since classes that are not registered cannot be found by name; parents first
PANELS = {name: getattr(bpy.types, name) for name in sorted(ours, key=lambda one: one not in OPEN)}
only_ours()
open_only(*PANELS)  # before they are drawn: Blender remembers which were closed
bpy.app.timers.register(tick, first_interval=2.0, persistent=True)
