"""The worker process: progress, failure, cancel, time limit. Needs no Blender window and no engine, only a Python."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

LIMIT_S = 20.0  # far more than any of these workers takes
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
)

FINISHED = '{"finished": true}'

HALTING_WRITER = """
import os, sys, time
print("a library says hello")
print('{"stage": "fit", "done": 3, "total": 4}')
print('{"stage": "half', end="", flush=True)
while not os.path.exists(os.path.join(sys.argv[1], "go")):
    time.sleep(0.01)
print('way", "done": 1, "total": 2}')
print("[1, 2]")
print('{"stage": 1}')
"""


@pytest.fixture
def job_module(addon: ModuleType) -> ModuleType:
    return __import__(f"{addon.__name__}.job", fromlist=["start_job"])


def start(job_module: ModuleType, code: str, time_limit_s: float = LIMIT_S):
    return job_module.start_job(lambda folder: [sys.executable, "-I", "-c", code, str(folder)], time_limit_s)


def wait_until(condition, limit_s: float = LIMIT_S) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def test_progress_is_followed_while_the_worker_runs_and_noise_is_ignored(job_module: ModuleType) -> None:
    job = start(job_module, HALTING_WRITER)
    wait_until(lambda: job.poll() is job_module.Outcome.RUNNING and job.stage == "fit")
    assert (job.done, job.total, job.fraction) == (3, 4, 0.75)
    (job.folder / "go").touch()
    assert job.wait() is job_module.Outcome.FINISHED
    assert (job.stage, job.done, job.total) == ("halfway", 1, 2)  # a line cut in two by the pipe is read whole
    job.remove()
    assert not job.folder.exists()


def test_a_failing_worker_is_quoted_by_its_last_line(job_module: ModuleType) -> None:
    job = start(job_module, "import sys; print('first', file=sys.stderr); sys.exit('sacha open: no such face')")
    assert job.wait() is job_module.Outcome.FAILED
    assert job.complaint() == "sacha open: no such face"
    job.remove()


def test_a_silent_failure_names_its_code(job_module: ModuleType) -> None:
    job = start(job_module, "import os; os._exit(7)")
    assert job.wait() is job_module.Outcome.FAILED
    assert "code 7" in job.complaint()
    job.remove()


def test_cancel_ends_a_worker_that_listens(job_module: ModuleType) -> None:
    job = start(job_module, "import time; time.sleep(60)")
    job.ask_to_stop()
    assert job.wait() is job_module.Outcome.CANCELLED
    assert job.complaint() == "Cancelled"
    job.remove()


def test_a_worker_that_does_not_listen_is_killed_after_the_grace(
    job_module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_module, "GRACE_S", 0.2)
    job = start(job_module, STUBBORN)
    wait_until(lambda: "deaf" in job.printed())
    job.ask_to_stop()
    assert job.wait() is job_module.Outcome.CANCELLED
    assert job.process.returncode == -signal.SIGKILL
    job.remove()


@pytest.mark.parametrize("said", [True, False])
def test_a_crash_after_all_is_done_is_told_but_no_failure(job_module: ModuleType, said: bool) -> None:
    code = f"import os, signal; print('{FINISHED}' if {said} else '', flush=True); os.kill(os.getpid(), signal.SIGSEGV)"
    job = start(job_module, code)
    assert job.wait() is (job_module.Outcome.FINISHED if said else job_module.Outcome.FAILED)
    assert job.aftermath() == ("signal 11" if said else "")
    assert "signal 11" in job.complaint()
    job.remove()


def test_a_worker_that_hangs_after_all_is_done_is_ended_and_has_finished(
    job_module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_module, "GRACE_S", 0.2)
    job = start(job_module, f"print('{FINISHED}', flush=True)\n{STUBBORN}")
    assert job.wait() is job_module.Outcome.FINISHED
    assert job.aftermath() == "signal 9"
    job.remove()


def test_the_time_limit_is_kept_and_named(job_module: ModuleType) -> None:
    job = start(job_module, "import time; time.sleep(60)", time_limit_s=0.2)
    assert job.wait() is job_module.Outcome.OUT_OF_TIME
    assert "0.2 s" in job.complaint()
    job.remove()


def test_what_the_worker_started_ends_with_it(job_module: ModuleType) -> None:
    code = "import subprocess, sys, time; print(subprocess.Popen(['sleep', '60']).pid, flush=True); time.sleep(60)"
    job = start(job_module, code)
    wait_until(lambda: job.printed().strip().isdigit())
    child = int(job.printed())
    job.end_now()
    wait_until(lambda: not is_running(child))
    job.remove()


def test_a_program_that_is_none_leaves_no_folder(
    job_module: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(job_module.tempfile, "tempdir", str(tmp_path))
    with pytest.raises(OSError, match="nowhere"):
        job_module.start_job(lambda folder: ["/nowhere/python", str(folder)], LIMIT_S)
    assert not list(tmp_path.iterdir())


def is_running(pid: int) -> bool:
    """Tell whether a process still runs; one that ended and waits for its parent does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
