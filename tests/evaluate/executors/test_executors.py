"""Executors: every job gets an outcome, failures stay where they are, and nothing goes on when nobody waits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from sacha_core.errors import FormatError, OptionError
from sacha_core.evaluate.executors.jobs import Job, Outcome, Unsettled
from sacha_core.evaluate.executors.local import LocalProcesses
from sacha_core.progress import Progress, Report, silent

PATIENCE_S = 60.0  # for what takes a moment on an idle machine


@dataclass(frozen=True)
class Act:
    """Work that a test chooses, done in another process."""

    what: str
    path: Path

    def __call__(self, report: Report) -> None:
        report(Progress(self.path.name, 1, 1))
        if self.what == "wrong input":
            raise FormatError("this is\nwrong")
        if self.what == "bug":
            raise RuntimeError("nobody thought of this")
        if self.what == "die":
            os._exit(7)
        if self.what == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        self.path.write_text(str(os.getpid()))
        if self.what == "wait":
            time.sleep(PATIENCE_S)


def wait_for(path: Path) -> int:
    until = time.monotonic() + PATIENCE_S
    while not (path.exists() and path.read_text()):
        assert time.monotonic() < until
        time.sleep(0.02)
    return int(path.read_text())


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0]


def assert_ends(pid: int) -> None:
    until = time.monotonic() + PATIENCE_S
    while is_running(pid):
        assert time.monotonic() < until, f"process {pid} goes on"
        time.sleep(0.02)


def test_jobs_wait_for_those_before_them_and_fall_with_them() -> None:
    """Oracle: the order by hand."""
    jobs = [Job("a", silent), Job("b", silent, ("a",)), Job("c", silent), Job("d", silent, ("b",))]
    unsettled = Unsettled(jobs)
    assert [job.name for job in iter(unsettled.take, None)] == ["a", "c"]
    assert list(unsettled.settle(Outcome("c"))) == [Outcome("c")]
    assert unsettled.take() is None
    assert [outcome.name for outcome in unsettled.settle(Outcome("a", "no"))] == ["a", "b", "d"]
    assert not unsettled


def test_processes_give_every_job_an_outcome(tmp_path: Path) -> None:
    """Oracle: what each job did."""
    kinds = ("fine", "wrong input", "bug", "die", "killed")
    jobs = [Job(kind, Act(kind, tmp_path / kind)) for kind in kinds]
    jobs += [
        Job("after", Act("fine", tmp_path / "after"), ("fine",)),
        Job("never", Act("fine", tmp_path / "never"), ("bug",)),
    ]
    told: list[str] = []
    outcomes = {o.name: o for o in LocalProcesses(2, 1).run(jobs, lambda progress: told.append(progress.stage))}
    assert outcomes["fine"] == Outcome("fine")
    assert outcomes["after"] == Outcome("after")
    assert outcomes["wrong input"] == Outcome("wrong input", "this is wrong")
    assert outcomes["bug"].error == "RuntimeError: nobody thought of this"
    assert "in __call__" in outcomes["bug"].trace
    assert outcomes["die"].error == "its process ended with exit status 7"
    assert outcomes["killed"].error == "its process was ended by signal SIGKILL; was there enough memory?"
    assert outcomes["never"].error == "not begun, since bug failed"
    assert not (tmp_path / "never").exists()
    assert {"fine", "after", "wrong input"} <= set(told)
    pids = {(tmp_path / name).read_text() for name in ("fine", "after")}
    assert len(pids | {str(os.getpid())}) == 3


def test_closing_the_iterator_ends_what_runs(tmp_path: Path) -> None:
    """Oracle: the system's list of processes."""
    jobs = [Job("short", Act("fine", tmp_path / "short")), Job("long", Act("wait", tmp_path / "long"))]
    outcomes = LocalProcesses(2, 1).run(jobs, silent)
    assert next(outcomes).name == "short"
    pid = wait_for(tmp_path / "long")
    outcomes.close()
    assert_ends(pid)


@pytest.mark.skipif(os.name != "posix", reason="kills by POSIX signals")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_jobs_end_with_whoever_waits_for_them(tmp_path: Path, how: signal.Signals) -> None:
    """Oracle: the system's list of processes."""
    script = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parent)!r}, {str(Path(__file__).parents[3])!r}]\n"
        "from pathlib import Path\n"
        "from test_executors import Act, Job, LocalProcesses, silent\n"
        f"if __name__ == '__main__': list(LocalProcesses(1, 1).run([Job('a', Act('wait', Path({str(tmp_path / 'a')!r})))], silent))\n"
    )
    (tmp_path / "main.py").write_text(script)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "main.py")], cwd=Path.cwd(), stderr=subprocess.DEVNULL
    ) as parent:
        pid = wait_for(tmp_path / "a")
        parent.send_signal(how)
    assert_ends(pid)


@pytest.mark.parametrize(("processes", "threads"), [(0, 1), (1, 0)])
def test_executors_of_nobody_are_refused(processes: int, threads: int) -> None:
    """Oracle: the error."""
    with pytest.raises(OptionError, match="expected 1 or more"):
        LocalProcesses(processes, threads)


def test_cores_are_shared_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: by hand."""
    monkeypatch.setattr("sacha_core.evaluate.executors.local.available_threads", lambda: 8)
    for given, expected in {
        (None, None): (8, 1),
        (2, None): (2, 4),
        (None, 4): (2, 4),
        (3, None): (3, 2),
        (16, None): (16, 1),
    }.items():
        local = LocalProcesses(*given)
        assert (local.processes, local.threads) == expected
