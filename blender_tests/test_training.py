"""Training from Blender: it survives Blender, is found again, is told from another process, and stops when it is asked to.

A small script stands in for the engine, so that what it does when can be chosen; test_film.py trains with the engine itself.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import bpy
import pytest
from conftest import EXTENSION

LIMIT_S = 60.0  # far more than anything here takes
PROGRESS = '{"stage": "train", "done": 250, "total": 1000, "seconds_left": 185.2, "values": {"loss": 0.125, "gaussians": 5040}}'
SIZE = {"w": 64, "h": 96}

ENGINE_STAND_IN = """#!{python}
import json, os, signal, sys, time
arguments = sys.argv[1:]
assert arguments[:2] == ["-m", "sacha_core"] and arguments[2] == "train", arguments
print("a library says hello", flush=True)
print('{progress}', flush=True)
{work}
report = arguments[arguments.index("--json") + 1]
open(report + ".part", "w").write(json.dumps({{"arguments": arguments}}))
os.replace(report + ".part", report)
"""


def make_engine(preferences, folder: Path, work: str) -> Path:
    """Make a program that stands in for the engine's Python, and name it in the preferences."""
    path = folder / "engine"
    path.write_text(ENGINE_STAND_IN.format(python=sys.executable, progress=PROGRESS, work=work))
    path.chmod(0o755)
    preferences.engine_python = str(path)
    return path


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A folder that says of itself what a dataset says."""
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "transforms_train.json").write_text(json.dumps(SIZE))
    return folder


@pytest.fixture
def run_folder(addon: ModuleType) -> ModuleType:
    return __import__(f"{addon.__name__}.making.run_folder", fromlist=["look"])


@pytest.fixture
def known_runs(addon: ModuleType, run_folder: ModuleType) -> ModuleType:
    """The list of trainings, empty before and after; what still trains is ended."""
    module = __import__(f"{addon.__name__}.making.known_runs", fromlist=["shown"])
    yield module
    for status in list(module.refresh()):
        status.run.process.end()
        module.forget(status.run.model)


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def start(dataset: Path, model: Path, **options: object) -> None:
    bpy.ops.sacha.train(dataset=str(dataset), model=str(model), wait=False, **options)


def standing(run_folder: ModuleType, model: Path) -> str:
    return status_module(run_folder).look(run_folder.find_run(model)).standing.value


def status_module(run_folder: ModuleType) -> ModuleType:
    return __import__(run_folder.__name__.replace("run_folder", "run_status"), fromlist=["look"])


def test_the_engine_is_told_what_was_set_up(preferences, known_runs, dataset: Path, tmp_path: Path) -> None:
    make_engine(preferences, tmp_path, "")
    setup = bpy.context.scene.sacha_making
    setup.dataset, setup.model, setup.variant, setup.iterations = str(dataset), str(tmp_path / "set up"), "paper", 77
    bpy.context.scene.sacha.head = "synthetic:small"
    assert bpy.ops.sacha.train() == {"FINISHED"}
    told = json.loads((tmp_path / "set up" / "run" / "report.json").read_text())["arguments"]
    assert told[2:6] == ["train", str(dataset), "-o", str(tmp_path / "set up")]
    assert " --head synthetic:small --variant paper --iterations 77 --seed 0 --device auto" in " ".join(told)
    bpy.ops.sacha.train(model=str(tmp_path / "given"), variant="ga", seed=3, shrink=2, finetune=True, restart=True)
    told = " ".join(json.loads((tmp_path / "given" / "run" / "report.json").read_text())["arguments"])
    assert (
        "--variant ga --iterations 77 --seed 3 --device auto --width 32 --height 48 --finetune-level 2 --restart"
        in told
    )


def test_progress_time_left_and_figures_are_found_by_any_blender(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    make_engine(preferences, tmp_path, "time.sleep(60)")
    start(dataset, tmp_path / "model")
    wait_until(lambda: known_runs.refresh()[0].said.total > 0)
    (status,) = known_runs.shown()
    assert (status.standing.value, status.said.fraction, status.said.left) == ("running", 0.25, "3 min 05 s left")
    assert status.said.figures == "loss 0.125, gaussians 5,040"
    with pytest.raises(RuntimeError, match=r"A training is going on in .*model already"):
        start(dataset, tmp_path / "model")
    bpy.ops.wm.read_homefile(use_empty=True)  # another file, the same user
    assert known_runs.refresh()[0].standing.value == "running"


def test_stopping_and_going_on(preferences, known_runs, run_folder, dataset: Path, tmp_path: Path) -> None:
    make_engine(preferences, tmp_path, "time.sleep(0 if os.path.exists('second') else 60)")
    model = tmp_path / "model"
    start(dataset, model, iterations=5, restart=True)
    wait_until(lambda: known_runs.refresh()[0].said.total > 0)
    process = known_runs.shown()[0].run.process
    bpy.ops.sacha.stop_training(model=str(model))
    wait_until(lambda: standing(run_folder, model) == "stopped")
    assert not process.lives()
    (model / "run" / "second").touch()
    assert bpy.ops.sacha.continue_training(model=str(model)) == {"FINISHED"}
    told = json.loads((model / "run" / "report.json").read_text())["arguments"]
    assert "--restart" not in told  # or it would begin anew
    assert told[told.index("--iterations") + 1] == "5"


def test_one_that_does_not_listen_is_ended_after_the_grace(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(status_module(run_folder), "GRACE_S", 0.2)
    make_engine(
        preferences,
        tmp_path,
        "signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)",
    )
    start(dataset, tmp_path / "model")
    wait_until(lambda: "deaf" in (tmp_path / "model" / "run" / "printed.jsonl").read_text())
    bpy.ops.sacha.stop_training(model=str(tmp_path / "model"))
    assert standing(run_folder, tmp_path / "model") == "stopping"
    wait_until(lambda: standing(run_folder, tmp_path / "model") == "stopped")


def test_one_that_is_killed_half_way_says_so_and_can_go_on(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    make_engine(preferences, tmp_path, "time.sleep(60)")
    start(dataset, tmp_path / "model")
    wait_until(lambda: known_runs.refresh()[0].said.total > 0)
    os.killpg(known_runs.shown()[0].run.process.number, signal.SIGKILL)
    wait_until(lambda: standing(run_folder, tmp_path / "model") == "failed")
    assert "ended from outside" in known_runs.refresh()[0].complaint.message
    assert known_runs.shown()[0].said.done == 250


def test_a_failure_is_quoted(preferences, known_runs, dataset: Path, tmp_path: Path) -> None:
    make_engine(preferences, tmp_path, "sys.exit('sacha train: the capture has no images')")
    with pytest.raises(RuntimeError, match="sacha train: the capture has no images"):
        bpy.ops.sacha.train(dataset=str(dataset), model=str(tmp_path / "model"))


def test_a_worker_that_writes_garbage_is_followed_as_far_as_it_makes_sense(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    lines = "os.urandom(200_000) + b'\\n{\"stage\": 1e999}\\n[[[' + b'[' * 100_000"
    garbage = f"sys.stdout.buffer.write({lines}); sys.exit(os.urandom(50).hex())"
    make_engine(preferences, tmp_path, garbage)
    with pytest.raises(RuntimeError, match=r"[0-9a-f]{100}"):
        bpy.ops.sacha.train(dataset=str(dataset), model=str(tmp_path / "model"))
    assert known_runs.refresh()[0].said.total in {0, 1000}


def test_another_process_under_the_same_number_is_not_taken_for_the_training(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    make_engine(preferences, tmp_path, "")
    bpy.ops.sacha.train(dataset=str(dataset), model=str(tmp_path / "model"))
    (tmp_path / "model" / "run" / "report.json").unlink()
    bystander = subprocess.Popen(["sleep", "60"], start_new_session=True)
    try:
        run = run_folder.find_run(tmp_path / "model")
        run_folder.write_run(replace(run, process=replace(run.process, number=bystander.pid)))
        assert standing(run_folder, tmp_path / "model") == "failed"
        bpy.ops.sacha.stop_training(model=str(tmp_path / "model"))
        run_folder.find_run(tmp_path / "model").process.end()
        assert bystander.poll() is None
    finally:
        bystander.kill()
        bystander.wait()


def test_of_another_machine_only_the_end_is_known(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    make_engine(preferences, tmp_path, "")
    bpy.ops.sacha.train(dataset=str(dataset), model=str(tmp_path / "model"))
    run_folder.write_run(replace(run_folder.find_run(tmp_path / "model"), machine="studio-7"))
    assert standing(run_folder, tmp_path / "model") == "finished"
    (tmp_path / "model" / "run" / "report.json").unlink()
    assert standing(run_folder, tmp_path / "model") == "on another machine"
    with pytest.raises(RuntimeError, match=r"A training is going on in .*model already on studio-7"):
        start(dataset, tmp_path / "model")  # it spoke a moment ago
    with pytest.raises(RuntimeError, match="runs on studio-7: stop it there"):
        bpy.ops.sacha.stop_training(model=str(tmp_path / "model"))


@pytest.mark.parametrize(
    "record",
    [
        "",
        "[]",
        "{",
        "{}",
        "[" * 100_000,
        '{"process": 5, "stop_asked_s": null}',
        '{"process": [1, "x"], "stop_asked_s": []}',
    ],
)
def test_what_is_no_record_of_a_training_is_none(known_runs, run_folder, tmp_path: Path, record: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text(record)
    assert run_folder.find_run(tmp_path) is None
    with pytest.raises(RuntimeError, match="holds no training that was started here"):
        bpy.ops.sacha.find_training(directory=str(tmp_path))


def test_a_record_of_another_command_is_not_run(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    make_engine(preferences, tmp_path, "")
    bpy.ops.sacha.train(dataset=str(dataset), model=str(tmp_path / "model"))
    run_folder.write_run(replace(run_folder.find_run(tmp_path / "model"), arguments=("prune", "/everything")))
    with pytest.raises(RuntimeError, match="holds no training"):
        bpy.ops.sacha.continue_training(model=str(tmp_path / "model"))


@pytest.mark.parametrize(
    ("transforms", "complaint"),
    [(None, "is no dataset: it has no transforms_train.json"), ("{", "damaged"), ('{"frames": []}', "damaged")],
)
def test_what_is_no_dataset_is_refused_before_anything_starts(
    preferences, known_runs, tmp_path: Path, transforms: str | None, complaint: str
) -> None:
    folder = tmp_path / "not one"
    folder.mkdir()
    if transforms is not None:
        (folder / "transforms_train.json").write_text(transforms)
    with pytest.raises(RuntimeError, match=complaint):
        bpy.ops.sacha.train(dataset=str(folder), model=str(tmp_path / "model"))
    assert not (tmp_path / "model").exists()
    with pytest.raises(RuntimeError, match="No dataset: name the folder of the capture"):
        bpy.ops.sacha.train(model=str(tmp_path / "model"))


def test_a_training_is_found_again_after_blender_was_killed(
    preferences, known_runs, run_folder, dataset: Path, tmp_path: Path
) -> None:
    """Another Blender starts it and is killed; this one finds it by its folder, still running, and stops it."""
    engine = make_engine(preferences, tmp_path, "time.sleep(60)")
    model = tmp_path / "model"
    code = (
        "import bpy, os, signal, sys\n"
        "bpy.ops.preferences.addon_enable(module=sys.argv[1])\n"
        "bpy.context.preferences.addons[sys.argv[1]].preferences.engine_python = sys.argv[2]\n"
        "bpy.ops.sacha.train(dataset=sys.argv[3], model=sys.argv[4], wait=False)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    command = [sys.executable, "-c", code, EXTENSION, str(engine), str(dataset), str(model)]
    dead = subprocess.run(
        command, check=False, timeout=LIMIT_S, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert dead.returncode == -signal.SIGKILL, dead.stderr
    (status,) = known_runs.refresh()  # the user's list has it
    assert (status.run.model, status.standing.value) == (model, "running")
    known_runs.forget(model)
    assert not known_runs.shown()
    bpy.ops.sacha.find_training(directory=str(model))
    wait_until(lambda: known_runs.refresh()[0].said.fraction == 0.25)
    bpy.ops.sacha.stop_training(model=str(model))
    wait_until(lambda: standing(run_folder, model) == "stopped")
