"""Other people's programs: where they are, and running one with a limit of time."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from sacha_core.errors import OptionError, ProgramError

__all__ = ["find_program", "named_program", "run_program"]

LIMIT_S = 240.0
LAST_LINE = 200  # letters of what a program said last


def named_program(variable: str) -> Path | None:
    """Give the program that an environment variable names; None where it names none.

    Args:
        variable: of the environment.

    Raises:
        OptionError: it names something that is no file.
    """
    named = os.environ.get(variable)
    if not named:
        return None
    if not Path(named).is_file():
        raise OptionError(f"{variable} names {named}, which is no file; expected the path of a program")
    return Path(named).absolute()


def find_program(variable: str, name: str) -> Path | None:
    """Give where a program is: the file that an environment variable names, or else by that name on the path; None where neither is.

    Args:
        variable: of the environment.
        name: of the program.

    Raises:
        OptionError: the variable names something that is no file; another program than the one that was meant is never taken instead.
    """
    found = named_program(variable) or shutil.which(name)
    return None if found is None else Path(found).absolute()


def run_program(
    arguments: Sequence[str | Path], folder: Path | None = None, limit_s: float = LIMIT_S, check: bool = True
) -> str:
    """Run a program to its end.

    Args:
        arguments: the program, by an absolute path, and what it is told.
        folder: that it works in; by default the one that we work in.
        limit_s: after so many seconds it is ended.
        check: whether any status but 0 is an error.

    Returns:
        What it said on its standard output, and after that on standard error.

    Raises:
        ProgramError: it could not be started, did not end in time, or ended with another status than 0; with its last line.
    """
    name = Path(arguments[0]).name
    try:
        done = subprocess.run(  # noqa: S603 - a program that the user named or installed, on files of our own making
            [os.fspath(one) for one in arguments], cwd=folder, capture_output=True, encoding="utf-8", errors="replace",
            timeout=limit_s, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise ProgramError(f"{name} took more than {limit_s:.0f} s") from error
    except OSError as error:
        raise ProgramError(f"{name} could not be started: {error.strerror}") from error
    if check and done.returncode:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines() or ["nothing said"]
        raise ProgramError(f"{name} ended with status {done.returncode}: {said[-1][:LAST_LINE]}")
    return done.stdout + done.stderr
