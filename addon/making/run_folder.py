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
from pathlib import Path

from ..processes import DETACHED, Process, find_process
from ..told import LOG, PRINTED, REPORT

__all__ = ["Run", "find_run", "reap", "start_run", "stop", "write_run"]

PLACE, RECORD = "run", "run.json"
SILENCE_S = 120.0  # after which a run on another machine is thought to have ended
ENVIRONMENT = ("PYTHONHOME", "PYTHONPATH")  # point at Blender's own Python, which is not the worker's

_children: list[
    subprocess.Popen[bytes]
] = []  # started here: held, so that the system forgets them once they have ended


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
    if found is not None and (found.process.lives() or _works_elsewhere(found)):
        where = "" if found.machine == platform.node() else f" on {found.machine}"
        raise ValueError(f"A training is going on in {model} already{where}: stop it first, or choose another folder")
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


def _works_elsewhere(run: Run) -> bool:
    """Tell whether a run on another machine, which shares the folder, said something a short while ago and has not finished."""
    printed = run.folder / PRINTED
    if run.machine == platform.node() or (run.folder / REPORT).is_file() or not printed.is_file():
        return False
    return time.time() - printed.stat().st_mtime < SILENCE_S


def write_run(run: Run) -> None:
    """Write what finds a run again, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    entry = asdict(run) | {"model": str(run.model), "process": [run.process.number, run.process.born]}
    aside = run.folder / f".{RECORD}.{os.getpid()}"
    aside.write_text(json.dumps(entry, indent=1), encoding="utf-8")
    aside.replace(run.folder / RECORD)


def reap() -> None:
    """Let the system forget those started here that have ended."""
    for child in [child for child in _children if child.poll() is not None]:
        _children.remove(child)


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


def stop(run: Run) -> Run:
    """Ask a run to stop; `run_status.look` ends it by force if it has not done so in time. The same training can go on later.

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
