# SPDX-License-Identifier: GPL-3.0-or-later
"""A training on disk: it goes on when Blender closes, and is found again by its folder. Knows nothing of Blender.

In the model's folder a folder `run` holds `run.json` (which process trains, since when, with what arguments, on which machine),
`printed.jsonl` (its progress), `log.txt`, and at the very end `report.json`. A run stands where these files and the machine's processes say
it does, so any Blender can tell.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path

from ..ending import NO_ENGINE, Ending, Heard
from ..processes import DETACHED, Process, find_process
from ..told import LOG, PRINTED, REPORT, Told, last_lines, last_told

__all__ = ["ENVIRONMENT", "Run", "Standing", "Status", "find_run", "look", "start_run", "stop", "write_run"]

PLACE, RECORD = "run", "run.json"
GRACE_S = 20.0  # between asking a training to stop and ending it: it writes what it needs to go on
LOG_LINES = 20
ENVIRONMENT = ("PYTHONHOME", "PYTHONPATH")  # point at Blender's own Python, which is not the worker's

_children: list[
    subprocess.Popen[bytes]
] = []  # started here: held, so that the system forgets them once they have ended


class Standing(Enum):
    """Where a run stands."""

    RUNNING = "running"
    STOPPING = "stopping"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
    ELSEWHERE = "on another machine"


@dataclass(frozen=True)
class Run:
    """One training.

    Args:
        model: the folder that the avatar goes to.
        arguments: of the engine, beginning with `train`.
        process: who trains.
        machine: where.
        started_s: when, seconds since 1970.
        stop_asked_s: when somebody asked it to stop; None where nobody did.
    """

    model: Path
    arguments: tuple[str, ...]
    process: Process
    machine: str
    started_s: float
    stop_asked_s: float | None = None

    @property
    def folder(self) -> Path:
        """Where the run's own files lie."""
        return self.model / PLACE


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


def start_run(program: Sequence[str], arguments: Sequence[str], model: Path) -> Run:
    """Start a training that Blender's end does not end.

    Args:
        program: the engine's Python and what makes it the engine.
        arguments: of the engine, beginning with `train`; one that was interrupted in this folder goes on.
        model: the folder that the avatar goes to; made where it is missing.

    Returns:
        The run.

    Raises:
        ValueError: a training is going on there already.
        OSError: the program cannot be started, or the folder not be written.
    """
    found = find_run(model)
    if found is not None and look(found).goes_on:
        raise ValueError(f"A training is going on in {model} already: stop it first, or choose another folder")
    folder = model / PLACE
    folder.mkdir(parents=True, exist_ok=True)
    (folder / REPORT).unlink(missing_ok=True)
    environment = {name: value for name, value in os.environ.items() if name not in ENVIRONMENT}
    with (folder / PRINTED).open("wb") as printed, (folder / LOG).open("wb") as log:
        child = subprocess.Popen(  # noqa: S603  (the program is the user's own choice; no shell is involved)
            [*program, *arguments, "--progress", "json", "--json", str(folder / REPORT)],
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=log,
            cwd=folder,
            env=environment,
            **DETACHED,
        )
    _children.append(child)
    process = find_process(child.pid) or Process(child.pid, "ended at once")
    run = Run(model, tuple(arguments), process, platform.node(), time.time())
    write_run(run)
    return run


def write_run(run: Run) -> None:
    """Write what finds a run again, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    entry = asdict(run) | {"model": str(run.model), "process": [run.process.number, run.process.born]}
    aside = run.folder / f".{RECORD}.{os.getpid()}"
    aside.write_text(json.dumps(entry, indent=1), encoding="utf-8")
    aside.replace(run.folder / RECORD)


def find_run(model: Path) -> Run | None:
    """Find the training of a model's folder; None where there is none, or what lies there is no record of one."""
    try:
        entry = json.loads((model / PLACE / RECORD).read_text(encoding="utf-8"))
        number, born = entry["process"]
        asked = entry["stop_asked_s"]
        return Run(
            model,
            tuple(map(str, entry["arguments"])),
            Process(int(number), str(born)),
            str(entry["machine"]),
            float(entry["started_s"]),
            None if asked is None else float(asked),
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def look(run: Run) -> Status:
    """Tell where a run stands; one that was asked to stop and does not is ended after a grace."""
    for child in [child for child in _children if child.poll() is not None]:
        _children.remove(child)
    log = last_lines(run.folder / LOG, LOG_LINES)
    standing = _standing(run)
    if standing is Standing.STOPPING and run.stop_asked_s is not None and time.time() - run.stop_asked_s > GRACE_S:
        run.process.end()
    return Status(run, standing, last_told(run.folder / PRINTED), _complaint(run, standing, log), log)


def stop(run: Run) -> Run:
    """Ask a run to stop; `look` ends it by force if it has not done so in time. The same training can go on later.

    Raises:
        ValueError: it is on another machine.
        OSError: the run's folder cannot be written.
    """
    if run.machine != platform.node():
        raise ValueError(f"This training runs on {run.machine}: stop it there")
    if run.stop_asked_s is not None or not run.process.lives():
        return run
    asked = Run(run.model, run.arguments, run.process, run.machine, run.started_s, time.time())
    write_run(asked)
    run.process.ask_to_end()
    return asked


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
