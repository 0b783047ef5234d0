"""What the panels of files, filming and training draw, held against what layouts really take."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
import pytest
from test_panels import drawn_by, operators, texts

LOG = ["first", "second"]


@pytest.fixture
def runs(addon: ModuleType) -> SimpleNamespace:
    """What the training panel draws from, and what makes it."""
    making = f"{addon.__name__}.making"
    return SimpleNamespace(
        known=__import__(f"{making}.known_runs", fromlist=["shown"]),
        folder=__import__(f"{making}.run_folder", fromlist=["Run"]),
        status=__import__(f"{making}.run_status", fromlist=["Status"]),
        told=__import__(f"{addon.__name__}.told", fromlist=["Told"]),
        ending=__import__(f"{addon.__name__}.ending", fromlist=["Ending"]),
        process=__import__(f"{addon.__name__}.processes", fromlist=["Process"]).Process(1, "long ago"),
    )


def status(runs: SimpleNamespace, name: str, kind: str = "", message: str = "") -> object:
    """Give a training that stands somewhere."""
    run = runs.folder.Run(Path("/models/anna"), ("train",), runs.process, "here", 0.0)
    said = runs.told.Told("train", 1200, 6000, 185.0, {"loss": 0.125})
    return runs.status.Status(run, runs.status.Standing[name], said, runs.ending.Ending(kind, message), LOG)


@pytest.mark.parametrize(
    ("standing", "offered"),
    [
        ("RUNNING", ["sacha.stop_training"]),
        ("STOPPING", []),
        ("FINISHED", ["sacha.open"]),
        ("STOPPED", ["sacha.continue_training"]),
        ("FAILED", ["sacha.continue_training"]),
        ("ELSEWHERE", []),
    ],
)
def test_each_training_offers_what_can_be_done_with_it(
    runs: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, standing: str, offered: list[str]
) -> None:
    monkeypatch.setattr(runs.known, "_seen", [status(runs, standing, "StaleWorker", "It was ended")])
    drawn = drawn_by(bpy.types.SACHA_PT_training)
    assert operators(drawn) == [
        *("sacha.train", "sacha.find_training", "sacha.forget_training"),
        *offered,
        "wm.path_open",
    ]
    assert ("progress" in [name for name, _ in drawn]) == (standing in {"RUNNING", "STOPPING"})


def test_progress_says_steps_time_and_figures(runs: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs.known, "_seen", [status(runs, "RUNNING")])
    drawn = drawn_by(bpy.types.SACHA_PT_training)
    assert ("progress", {"factor": 0.2, "text": "train 1,200/6,000, 3 min 05 s left"}) in drawn
    assert {"anna: running", "loss 0.125", *LOG} <= set(texts(drawn))


def test_a_failure_says_what_to_do(runs: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs.known, "_seen", [status(runs, "FAILED", "StaleWorker", "It was ended from outside")])
    said = " ".join(texts(drawn_by(bpy.types.SACHA_PT_training)))
    assert "It was ended from outside" in said
    assert "Start it again; what was finished before is kept" in said


def test_the_number_of_pictures_is_told_before_filming(opened: bpy.types.Object) -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.sacha_making.frame_step = 1, 10, 3
    bpy.ops.sacha.add_cameras(count=5)
    assert bpy.types.SACHA_PT_film.poll(bpy.context)
    drawn = drawn_by(bpy.types.SACHA_PT_film)
    assert "5 cameras by 4 frames: 20 pictures" in texts(drawn)
    assert operators(drawn) == ["sacha.add_cameras", "sacha.film"]


def test_the_size_is_asked_for_as_it_is_decided(addon: ModuleType) -> None:
    setup = bpy.context.scene.sacha_making
    for by, asked in (("LEVEL", {"level"}), ("SIZE", {"target_kb"}), ("ARCHIVE", set())):
        setup.size_by = by
        drawn = drawn_by(bpy.types.SACHA_PT_files)
        found = {given["property"] for name, given in drawn if name == "prop"}
        assert found & {"level", "target_kb"} == asked
