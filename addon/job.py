# SPDX-License-Identifier: GPL-3.0-or-later
"""One command of the engine, running in a process of its own while Blender stays free. Knows nothing of Blender."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path
from typing import IO, Any

from . import leftovers, told
from .ending import Ending, Heard, ending, exit_status, quoted
from .processes import DETACHED
from .told import LOG, PRINTED, Told

__all__ = ["Job", "Outcome", "start_job"]

GRACE_S = 5.0  # between asking a worker to stop and ending it
TICK_S = 0.05  # how often a waiting caller looks
LONGEST_LINE = 1 << 20  # bytes: a line without an end is no progress, and must not fill the memory
BLENDER_ONLY = ("PYTHONHOME", "PYTHONPATH")  # point at Blender's own Python, which is not the worker's


class Outcome(Enum):
    """Where a job stands."""

    RUNNING = auto()
    FINISHED = auto()
    FAILED = auto()
    CANCELLED = auto()
    OUT_OF_TIME = auto()


@dataclass
class Job:
    """A worker process, its folder, and what it last said.

    Args:
        process: the worker, leader of a session of its own.
        folder: its working folder, removed by `remove`; what it prints lies there, and its results if the command is told so.
        output: read end of the progress that the worker writes, one JSON object a line.
        time_limit_s: how long it may take.
        said: its last line of progress.
        heard: what else it said: who it is, and what ended it.
    """

    process: subprocess.Popen[bytes]
    folder: Path
    output: IO[bytes]
    time_limit_s: float
    said: Told = field(default_factory=Told)
    heard: Heard = field(default_factory=Heard)
    started_s: float = field(default_factory=time.monotonic)
    _unfinished_line: bytes = b""
    _stop_asked_s: float | None = None
    _finished_s: float | None = None
    _outcome: Outcome = Outcome.RUNNING

    @property
    def fraction(self) -> float:
        """Part of the present stage that is done, 0 to 1."""
        return self.said.fraction

    @property
    def stage(self) -> str:
        """What the worker is doing, in its own words; empty where it said nothing yet."""
        return self.said.stage

    @property
    def done(self) -> int:
        """Steps of that stage finished."""
        return self.said.done

    @property
    def total(self) -> int:
        """Steps of that stage."""
        return self.said.total

    @property
    def seconds_left(self) -> float | None:
        """In that stage; None while unknown."""
        return self.said.seconds_left

    @property
    def values(self) -> dict[str, float]:
        """Figures of that stage, by name."""
        return self.said.values

    def poll(self) -> Outcome:
        """Take in new progress, hold the worker to its limits, and say where the job stands."""
        if self._outcome is not Outcome.RUNNING:
            return self._outcome
        code = self.process.poll()
        self._read_progress()
        if code is None:
            self._hold_to_limits(time.monotonic())
            return Outcome.RUNNING
        self.output.close()
        if self.heard.disagreement() is not None:
            self._outcome = Outcome.FAILED
        elif code == 0 or self.heard.finished:
            self._outcome = Outcome.FINISHED
        elif self._stop_asked_s is None:
            self._outcome = Outcome.FAILED
        elif self._stop_asked_s - self.started_s > self.time_limit_s:
            self._outcome = Outcome.OUT_OF_TIME
        else:
            self._outcome = Outcome.CANCELLED
        return self._outcome

    def _hold_to_limits(self, now_s: float) -> None:
        """Ask a worker to stop that has no more to do, or is not worth waiting for; end it where it has not listened."""
        if self._stop_asked_s is not None:
            if now_s - self._stop_asked_s > GRACE_S:
                self._signal(kill=True)
        elif self.heard.disagreement() is not None:  # what it does would be misread
            self.ask_to_stop()
        elif self.heard.finished:
            self._finished_s = self._finished_s or now_s
            if now_s - self._finished_s > GRACE_S:  # programs hang at their end, too
                self.ask_to_stop()
        elif now_s - self.started_s > self.time_limit_s:
            self.ask_to_stop()

    def wait(self) -> Outcome:
        """Poll until the worker has ended; never longer than its time limit and the grace."""
        while self.poll() is Outcome.RUNNING:
            time.sleep(TICK_S)
        return self._outcome

    def ask_to_stop(self) -> None:
        """Ask the worker to end; `poll` ends it by force if it has not done so in time."""
        if self._stop_asked_s is None:
            self._stop_asked_s = time.monotonic()
            self._signal(kill=False)

    def end_now(self) -> None:
        """End the worker by force and wait until it is gone: Blender is about to close."""
        self.ask_to_stop()
        self._signal(kill=True)
        self.process.wait()
        self.poll()

    def aftermath(self) -> str:
        """Say how a worker that had finished its work crashed or hung after that; empty where it ended as programs should."""
        code = self.process.returncode
        return "" if self._outcome is not Outcome.FINISHED or not code else exit_status(code)

    def complaint(self) -> str:
        """Say why the job did not finish, in one line."""
        if self._outcome is Outcome.CANCELLED:
            return "Cancelled"
        if self._outcome is Outcome.OUT_OF_TIME:
            return f"Stopped: it took longer than {self.time_limit_s:g} s"
        return self._ending().message

    def report(self) -> dict[str, Any]:
        """Give the report that the command was told to write to `report.json` in the job's folder.

        Raises:
            ValueError: there is none, or it is none; in one sentence.
        """
        return told.read_report(self.folder / told.REPORT)

    @property
    def kind(self) -> str:
        """What kind of problem ended the job (`advice.py`); empty where none did or none is known."""
        if self._outcome is Outcome.OUT_OF_TIME:
            return "OutOfTime"
        return self._ending().kind if self._outcome is Outcome.FAILED else ""

    def quoted(self) -> str:
        """Give how the worker was called and the end of its log, for diagnostics."""
        return quoted(self.process.args, self.process.returncode, self.folder)

    def printed(self) -> str:
        """Give all that the worker wrote to its standard output."""
        return (self.folder / PRINTED).read_text(errors="replace")

    def remove(self) -> None:
        """Remove the job's folder."""
        shutil.rmtree(self.folder)

    def _ending(self) -> Ending:
        return ending(self.process.args, self.process.returncode, self.folder, self.heard)

    def _read_progress(self) -> None:
        """Take in what the worker has written since the last time; a line that is not whole yet waits."""
        while written := self.output.read(LONGEST_LINE):
            *lines, rest = (self._unfinished_line + written).split(b"\n")
            self._unfinished_line = rest[-LONGEST_LINE:]
            for line in lines:
                if not self.heard.line(line):
                    self.said = told.parse_line(line) or self.said

    def _signal(self, *, kill: bool) -> None:
        """Tell the worker, and on POSIX whatever it started, to end."""
        if self.process.poll() is not None:
            return
        if os.name == "posix":
            os.killpg(self.process.pid, signal.SIGKILL if kill else signal.SIGTERM)
        elif kill:
            self.process.kill()
        else:
            self.process.terminate()


def start_job(command: Callable[[Path], list[str]], time_limit_s: float) -> Job:
    """Start a command in a new folder, detached from Blender's input and signals.

    Args:
        command: gives program and arguments, given the job's folder.
        time_limit_s: how long it may take.

    Returns:
        The running job.

    Raises:
        OSError: the program cannot be started, or no folder can be made.
    """
    folder = Path(tempfile.mkdtemp(prefix=leftovers.PREFIX))
    environment = {name: value for name, value in os.environ.items() if name not in BLENDER_ONLY}
    printed = folder / PRINTED
    try:
        with printed.open("wb") as stdout, (folder / LOG).open("wb") as stderr:
            process = subprocess.Popen(  # noqa: S603  (the program is the user's own choice; no shell is involved)
                command(folder),
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                cwd=folder,
                env=environment,
                **DETACHED,
            )
    except (OSError, ValueError):
        shutil.rmtree(folder)
        raise
    leftovers.mark(folder, process.pid)
    return Job(process, folder, printed.open("rb"), time_limit_s)
