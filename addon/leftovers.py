# SPDX-License-Identifier: GPL-3.0-or-later
"""What a Blender that crashed leaves behind: workers that nobody waits for, and their folders. Knows nothing of Blender.

A job's folder says which worker and which Blender it belongs to. Where that Blender is gone, the worker is ended and the folder removed;
a folder that does not say so, or is another user's, is none of ours and is left alone.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path

from .processes import Process, find_process

__all__ = ["PREFIX", "mark", "sweep"]

PREFIX = "sacha-"  # of the names of jobs' folders
OWNER = "owner.json"


def mark(folder: Path, worker_number: int) -> None:
    """Write into a job's folder whose it is: this worker's, and this Blender's.

    Raises:
        OSError: it cannot be written.
    """
    owners = {"worker": find_process(worker_number), "blender": find_process(os.getpid())}
    entry = {name: None if process is None else [process.number, process.born] for name, process in owners.items()}
    (folder / OWNER).write_text(json.dumps(entry), encoding="utf-8")


def sweep() -> int:
    """Clear away what Blenders left that are gone; give how many jobs that were."""
    return sum(_swept(folder) for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"))


def _swept(folder: Path) -> bool:
    """Clear one job away if it is an orphan of ours."""
    owners = _owners(folder)
    if owners is None or owners["blender"] is None or owners["blender"].lives():
        return False
    if owners["worker"] is not None:
        owners["worker"].end()
    shutil.rmtree(
        folder, ignore_errors=True
    )  # what cannot go now goes with the system's own clearing of temporary files
    return True


def _owners(folder: Path) -> dict[str, Process | None] | None:
    """Read whose a folder is; None where it is none of ours."""
    try:
        if folder.is_symlink() or (hasattr(os, "getuid") and folder.stat().st_uid != os.getuid()):
            return None
        entry = json.loads((folder / OWNER).read_text(encoding="utf-8"))
        return {name: _process(entry[name]) for name in ("worker", "blender")}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _process(entry: list | None) -> Process | None:
    """Read one process; None where it was not found when its number was written down."""
    if entry is None:
        return None
    number, born = entry
    return Process(int(number), str(born))
