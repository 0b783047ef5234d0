"""A job ends on the thing that it began with, whatever became of it meanwhile: renamed, another in its place, removed, undone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Material

LIMIT_S = 60.0  # far more than the engine takes for any of these
TIMER = SimpleNamespace(type="TIMER")


@dataclass(frozen=True)
class Case:
    """A command that ends on what is open.

    Args:
        operator: of `bpy.ops.sacha`.
        options: its options; in texts {material} stands for the folder of the material, {out} for one to write to.
        trace: gives what of an object the command changes.
    """

    operator: str
    options: dict[str, str | int]
    trace: Callable[[bpy.types.Object], Any]


def n_materials(thing: bpy.types.Object) -> int:
    """Count the slots that have a material."""
    return sum(material is not None for material in thing.data.materials)


def n_splats(thing: bpy.types.Object) -> int:
    """Count the objects that are splats of a head."""
    return sum(other.sacha_splats.head == thing for other in bpy.data.objects)


CASES = {
    "Compare": Case("compare", {"filepath": "{material}/other.sacha"}, lambda thing: thing.data.sacha.compared),
    "Load Motion": Case("load_motion", {"filepath": "{out}/nod.npz"}, lambda thing: thing.data.sacha_rig.n_frames),
    "Regions From": Case("regions_from", {"kind": "FACE_SETS"}, lambda thing: thing.data.sacha_steering.custom),
    "Apply Budget": Case("apply_budget", {"filepath": "{out}/new.sacha"}, lambda thing: thing.data.sacha.source),
    "Show Splats": Case("show_splats", {}, n_splats),
    "Bake Heat Map": Case("bake_heat_map", {"filepath": "{out}/map.png", "size": 64}, n_materials),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys())
def case(request: pytest.FixtureRequest) -> Case:
    return request.param


@pytest.fixture
def running(addon: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The add-on's way of running jobs, made to believe that events come."""
    module = __import__(f"{addon.__name__}.running", fromlist=["execute"])
    monkeypatch.setattr(module, "events_come", lambda: True)
    yield module
    module.end_now()


@pytest.fixture
def head(opened: bpy.types.Object, material: Material, tmp_path: Path) -> bpy.types.Object:
    """The material's avatar with face sets, few pictures to score it by, and a motion of two frames, a nod, in a file."""
    arrays = {name: np.zeros((2, 3), np.float32) for name in ("rotation", "neck_pose", "jaw_pose", "translation")}
    arrays["neck_pose"][1, 0] = 0.2
    n_expressions = material.truth["expression"].shape[1]
    arrays |= {"expr": np.zeros((2, n_expressions), np.float32), "eyes_pose": np.zeros((2, 6), np.float32)}
    np.savez(tmp_path / "nod.npz", shape=material.truth["shape"], frame_rate=np.array(25.0), **arrays)
    sets = opened.data.attributes.new(".sculpt_face_set", "INT", "FACE")
    sets.data.foreach_set("value", (np.arange(len(opened.data.polygons)) % 2 + 1).astype(np.int32))
    opened.data.sacha_steering.views = 4
    return opened


def begin(case: Case, material: Material, folder: Path) -> bpy.types.Operator:
    """Begin a command as a window does, and give the operator that Blender keeps for its events."""
    places = {"material": str(material.folder), "out": str(folder)}
    options = {
        name: value.format(**places) if isinstance(value, str) else value for name, value in case.options.items()
    }
    assert getattr(bpy.ops.sacha, case.operator)("EXEC_DEFAULT", wait=False, **options) == {"RUNNING_MODAL"}
    return bpy.context.window.modal_operators[0]


def end(operator: bpy.types.Operator) -> set[str]:
    """Send timer events until the command is over; give its answer."""
    limit = time.monotonic() + LIMIT_S
    while (answer := type(operator).modal(operator, bpy.context, TIMER)) == {"PASS_THROUGH"}:
        assert time.monotonic() < limit, "waited in vain"
        time.sleep(0.02)
    return answer


def put_in_its_place(head: bpy.types.Object, names: tuple[str, str]) -> bpy.types.Object:
    """Give another head the names that an object and its mesh had."""
    twin = head.copy()
    twin.data = head.data.copy()
    bpy.context.collection.objects.link(twin)
    twin.name, twin.data.name = names
    assert (twin.name, twin.data.name) == names
    return twin


def test_what_was_renamed_takes_the_result_and_another_of_its_name_does_not(
    case: Case, head: bpy.types.Object, running: ModuleType, material: Material, tmp_path: Path
) -> None:
    before, names = case.trace(head), (head.name, head.data.name)
    operator = begin(case, material, tmp_path)
    head.name, head.data.name = "somebody else", "something else"
    twin = put_in_its_place(head, names)
    assert end(operator) == {"FINISHED"}
    assert case.trace(head) != before
    assert case.trace(twin) == before


def test_what_was_removed_is_missed_and_another_of_its_name_stays_as_it_is(
    case: Case, head: bpy.types.Object, running: ModuleType, material: Material, tmp_path: Path, addon: ModuleType
) -> None:
    before, names, mesh = case.trace(head), (head.name, head.data.name), head.data
    operator = begin(case, material, tmp_path)
    head.name, mesh.name = "somebody else", "something else"
    twin = put_in_its_place(head, names)
    bpy.data.objects.remove(head)
    bpy.data.meshes.remove(mesh)
    assert end(operator) == {"CANCELLED"}
    problem = __import__(f"{addon.__name__}.problem", fromlist=["last"]).last()
    assert f"{names[0]} is gone: nothing" in problem.message
    for written in (*tmp_path.glob("*.sacha"), *tmp_path.glob("*.png")):  # not lost: the message says where it is
        assert written.name in problem.message
        assert str(tmp_path) in problem.message
    assert case.trace(twin) == before


def test_undo_makes_other_things_of_the_same_ones_and_the_result_finds_them(
    case: Case, head: bpy.types.Object, running: ModuleType, material: Material, tmp_path: Path
) -> None:
    bpy.ops.ed.undo_push(message="opened")
    before, name = case.trace(head), head.name
    operator = begin(case, material, tmp_path)
    bpy.context.scene.frame_end += 1
    bpy.ops.ed.undo_push(message="something")
    bpy.ops.ed.undo()
    assert end(operator) == {"FINISHED"}
    assert case.trace(bpy.data.objects[name]) != before


def test_numbers_of_a_file_that_undo_took_away_are_not_put_on(
    head: bpy.types.Object, running: ModuleType, material: Material, tmp_path: Path, addon: ModuleType
) -> None:
    name = head.name
    bpy.ops.ed.undo_push(message="opened")
    bpy.ops.sacha.apply_budget(filepath=str(tmp_path / "new.sacha"))
    bpy.ops.ed.undo_push(message="applied")
    operator = begin(CASES["Compare"], material, tmp_path)
    bpy.ops.ed.undo()
    shown = bpy.data.objects[name].data.sacha
    facts = [fact.name for fact in shown.facts]
    assert end(operator) == {"CANCELLED"}
    problem = __import__(f"{addon.__name__}.problem", fromlist=["last"]).last()
    assert "shows avatar.sacha now, no longer new.sacha: do this again" in problem.message
    assert [fact.name for fact in bpy.data.objects[name].data.sacha.facts] == facts
