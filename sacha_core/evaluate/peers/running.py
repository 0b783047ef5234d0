"""Other people's programs: where they are, and running one with a limit of time."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from sacha_core.evaluate.peers.peer import PeerError

__all__ = ["find_program", "run_program"]

LIMIT_S = 240.0
LAST_LINE = 200  # letters of what a program said last


def find_program(variable: str, name: str) -> Path | None:
    """Give where a program is: the file that an environment variable names, or else by that name on the path; None where neither is.

    Args:
        variable: of the environment.
        name: of the program.
    """
    named = os.environ.get(variable)
    found = named if named and Path(named).is_file() else shutil.which(name)
    return None if found is None else Path(found).absolute()


def run_program(arguments: Sequence[str | Path], folder: Path, limit_s: float = LIMIT_S) -> str:
    """Run a program to its end.

    Args:
        arguments: the program and what it is told.
        folder: that it works in.
        limit_s: after so many seconds it is ended.

    Returns:
        What it said on its standard output.

    Raises:
        PeerError: it could not be started, did not end in time, or ended with another status than 0; with its last line.
    """
    name = Path(arguments[0]).name
    try:
        done = subprocess.run(  # noqa: S603 - a program that the user installed, on files of our own making
            [os.fspath(one) for one in arguments], cwd=folder, capture_output=True, text=True, errors="replace",
            timeout=limit_s, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise PeerError(f"{name} took more than {limit_s:.0f} s") from error
    except OSError as error:
        raise PeerError(f"{name} could not be started: {error.strerror}") from error
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines() or ["nothing said"]
        raise PeerError(f"{name} ended with status {done.returncode}: {said[-1][:LAST_LINE]}")
    return done.stdout
