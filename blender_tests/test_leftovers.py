"""What a Blender that crashed leaves behind, and only that, is cleared away; and processes are told apart."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

LIMIT_S = 20.0  # far more than any of these takes


@pytest.fixture
def modules(addon: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The add-on's modules, with a temporary folder of their own."""
    named = {name: __import__(f"{addon.__name__}.{name}", fromlist=["x"]) for name in ("leftovers", "processes", "job")}
    monkeypatch.setattr(named["leftovers"].tempfile, "tempdir", str(tmp_path))
    return SimpleNamespace(**named)


@pytest.fixture
def worker() -> Iterator[subprocess.Popen]:
    """A process that goes on until it is ended."""
    process = subprocess.Popen(["sleep", "60"], start_new_session=True)
    yield process
    process.kill()
    process.wait()


def job_folder(tmp_path: Path, worker: object, blender: object) -> Path:
    folder = tmp_path / "sacha-job"
    folder.mkdir()
    (folder / "log.txt").write_text("half way")
    (folder / "owner.json").write_text(json.dumps({"worker": worker, "blender": blender}))
    return folder


def entry(modules: SimpleNamespace, process: subprocess.Popen) -> list:
    found = modules.processes.find_process(process.pid)
    return [found.number, found.born]


def ended(process: subprocess.Popen) -> bool:
    try:
        process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        return False
    return True


def test_the_worker_of_a_blender_that_is_gone_is_ended_and_its_folder_removed(modules, worker, tmp_path: Path) -> None:
    folder = job_folder(tmp_path, entry(modules, worker), [999_999, "long ago"])
    assert modules.leftovers.sweep() == 1
    assert ended(worker)
    assert not folder.exists()


def test_the_worker_of_a_blender_that_lives_is_left_alone(modules, worker, tmp_path: Path) -> None:
    mine = modules.processes.find_process(os.getpid())
    folder = job_folder(tmp_path, entry(modules, worker), [mine.number, mine.born])
    assert modules.leftovers.sweep() == 0
    assert worker.poll() is None
    assert (folder / "log.txt").exists()


def test_another_process_under_a_workers_number_is_not_ended(modules, worker, tmp_path: Path) -> None:
    job_folder(tmp_path, [worker.pid, "another birth"], [os.getpid(), "another birth"])
    assert modules.leftovers.sweep() == 1  # this very process has the number of that Blender, but is another
    assert worker.poll() is None


@pytest.mark.parametrize(
    "owner", [None, "", "[]", "{}", "[" * 100_000, '{"worker": 5, "blender": [1]}', '{"worker": null, "blender": null}']
)
def test_files_that_are_not_ours_are_left_alone(modules, tmp_path: Path, owner: str | None) -> None:
    folder = tmp_path / "sacha-holiday"
    folder.mkdir()
    (folder / "precious.txt").write_text("precious")
    if owner is not None:
        (folder / "owner.json").write_text(owner)
    (tmp_path / "sacha-file").write_text("a file")
    assert modules.leftovers.sweep() == 0
    assert (folder / "precious.txt").read_text() == "precious"


def test_a_link_is_not_followed(modules, worker, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    job_folder(elsewhere, entry(modules, worker), [999_999, "long ago"])
    (tmp_path / "sacha-link").symlink_to(elsewhere / "sacha-job")
    assert modules.leftovers.sweep() == 0
    assert worker.poll() is None


def test_a_job_says_whose_it_is(modules) -> None:
    job = modules.job.start_job(lambda _: [sys.executable, "-I", "-c", "import time; time.sleep(60)"], LIMIT_S)
    owners = modules.leftovers._owners(job.folder)
    assert owners["worker"] == modules.processes.find_process(job.process.pid)
    assert owners["blender"] == modules.processes.find_process(os.getpid())
    assert modules.leftovers.sweep() == 0
    job.end_now()
    job.remove()


def test_a_process_is_itself_until_it_has_ended(modules, worker) -> None:
    process = modules.processes.find_process(worker.pid)
    assert process.lives()
    assert process == modules.processes.find_process(worker.pid)
    process.end()
    end = time.monotonic() + LIMIT_S
    while process.lives():  # not even while nobody has looked at its end
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)
    assert modules.processes.find_process(worker.pid) is None
    for nobody in (0, -1, 2**22 + 1):
        assert modules.processes.find_process(nobody) is None


def test_ps_tells_the_same_as_the_kernel(modules, worker) -> None:
    """What other POSIX systems are asked instead of /proc."""
    born = modules.processes._born_by_ps(worker.pid)
    if born is None and not Path("/bin/ps").exists():
        pytest.skip("there is no ps here")
    assert born
    assert modules.processes._born_by_ps(worker.pid) == born
    worker.kill()
    end = time.monotonic() + LIMIT_S
    while modules.processes._born_by_ps(worker.pid) is not None:
        assert time.monotonic() < end, "waited in vain"


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (b'{"stage": "fit", "done": 1, "total": 4}', ("fit", 1, 4)),
        (b'{"stage": "fit", "done": 9, "total": 4}', ("fit", 9, 4)),
        (b'{"stage": "fit", "done": 1e999, "total": 4}', None),
        (b'{"stage": "fit", "done": NaN, "total": 4}', None),
        (b'{"stage": "fit", "done": 1, "total": 4, "values": 5}', None),
        (b'{"stage": "' + b"x" * 500 + b'", "done": 1, "total": 4}', None),
        (b"[" * 100_000, None),
        (b"\xff\xfe", None),
        (b"5", None),
    ],
)
def test_lines_of_progress_are_read_as_far_as_they_make_sense(
    addon: ModuleType, line: bytes, told: tuple | None
) -> None:
    module = __import__(f"{addon.__name__}.told", fromlist=["parse_line"])
    said = module.parse_line(line)
    assert (None if said is None else (said.stage, said.done, said.total)) == told
    assert said is None or 0.0 <= said.fraction <= 1.0


def test_the_last_line_that_is_whole_counts_however_long_the_file(addon: ModuleType, tmp_path: Path) -> None:
    module = __import__(f"{addon.__name__}.told", fromlist=["last_told"])
    path = tmp_path / "printed.jsonl"
    assert module.last_told(path) == module.Told()
    line = '{"stage": "train", "done": %d, "total": 100000, "seconds_left": 3.5}\n'
    path.write_text("".join(line % i for i in range(100_000)) + "a library speaks\n" + (line % 5)[:-4])
    assert module.last_told(path).done == 99_999
    assert module.last_told(path).left == "4 s left"
