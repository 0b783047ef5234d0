# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a training stands, by what it left in its folder and by the machine's processes. Knows nothing of Blender."""

from __future__ import annotations

import platform
import time
from dataclasses import dataclass
from enum import Enum

from ..ending import NO_ENGINE, Ending, Heard
from ..told import LOG, PRINTED, REPORT, Told, last_lines, last_told
from .run_folder import Run, reap

__all__ = ["Standing", "Status", "look"]

GRACE_S = 20.0  # between asking a training to stop and ending it: it writes what it needs to go on
LOG_LINES = 20


class Standing(Enum):
    """Where a run stands."""

    RUNNING = "running"
    STOPPING = "stopping"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
    ELSEWHERE = "on another machine"


@dataclass(frozen=True)
class Status:
    """What a look at a run found.

    Args:
        run: the run.
        standing: where it stands.
        said: its last progress.
        complaint: why it is not going on, in one line, and its kind (see `advice`); empty where it is, or has finished.
        log: the last lines that it wrote to its log.
    """

    run: Run
    standing: Standing
    said: Told
    complaint: Ending
    log: list[str]

    @property
    def goes_on(self) -> bool:
        """Whether its process works, as far as that can be told."""
        return self.standing in {Standing.RUNNING, Standing.STOPPING}


def look(run: Run) -> Status:
    """Tell where a run stands; one that was asked to stop and does not is ended after a grace."""
    reap()
    log = last_lines(run.folder / LOG, LOG_LINES)
    standing = _standing(run)
    if standing is Standing.STOPPING and run.stop_asked_s is not None and time.time() - run.stop_asked_s > GRACE_S:
        run.process.end()
    return Status(run, standing, last_told(run.folder / PRINTED), _complaint(run, standing, log), log)


def _standing(run: Run) -> Standing:
    if (run.folder / REPORT).is_file():
        return Standing.FINISHED
    if run.machine != platform.node():
        return Standing.ELSEWHERE
    if run.process.lives():
        return Standing.RUNNING if run.stop_asked_s is None else Standing.STOPPING
    if (run.folder / REPORT).is_file():  # it finished between the two looks
        return Standing.FINISHED
    return Standing.FAILED if run.stop_asked_s is None else Standing.STOPPED


def _complaint(run: Run, standing: Standing, log: list[str]) -> Ending:
    """Say why a run is not going on."""
    if standing is Standing.ELSEWHERE:
        return Ending("", f"It was started on {run.machine}; whether it still runs can only be told there")
    if standing is Standing.STOPPED:
        return Ending("", "Stopped; it can go on where it was")
    return _failure(run, log) if standing is Standing.FAILED else Ending("", "")


def _failure(run: Run, log: list[str]) -> Ending:
    """Say why a run ended that nobody stopped."""
    heard = Heard()
    for line in last_lines(run.folder / PRINTED, LOG_LINES):
        heard.line(line.encode())
    if heard.error is not None:
        return heard.error
    if any(sentence in line for line in log for sentence in NO_ENGINE):
        return Ending("NoEngine", "The Python of the preferences has no SACHA engine")
    if log:
        return Ending("EngineBroken" if any(line.startswith("Traceback (") for line in log) else "", log[-1])
    return Ending(
        "StaleWorker", "It was ended from outside without a word: memory ran out, or the machine was shut down"
    )
