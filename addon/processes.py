# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes that outlive whoever started them: is it still that one, and how it is ended. Knows nothing of Blender.

A process number alone names nobody: systems give the numbers of ended processes to new ones. Together with the moment at which it was
born, it does, so both are kept, and nothing is ended or believed alive by its number alone.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["DETACHED", "Process", "find_process"]

ASK_TIME_LIMIT_S = 5.0  # for `ps`, which answers at once
ENDED = ("Z", "X")  # states of a process that has ended and whose parent has not looked yet

# How a worker is started so that neither Ctrl-C in Blender's terminal nor Blender's end reaches it.
DETACHED: dict[str, Any] = (
    {"start_new_session": True}
    if os.name == "posix"
    else {"creationflags": 0x00000200 | 0x08000000}  # CREATE_NEW_PROCESS_GROUP, CREATE_NO_WINDOW
)


@dataclass(frozen=True)
class Process:
    """One process of this machine, for good.

    Args:
        number: its process number.
        born: when it began, in the system's own words.
    """

    number: int
    born: str

    def lives(self) -> bool:
        """Tell whether it still runs: not ended, and not another one under its number."""
        return _born(self.number) == self.born

    def ask_to_end(self) -> None:
        """Ask it and what it started to end; where systems know no asking it is ended."""
        self._tell(signal.SIGTERM)

    def end(self) -> None:
        """End it and what it started by force."""
        self._tell(getattr(signal, "SIGKILL", signal.SIGTERM))

    def _tell(self, what: int) -> None:
        if not self.lives():
            return
        try:
            if os.name == "posix" and os.getpgid(self.number) == self.number:
                os.killpg(self.number, what)
            else:
                os.kill(self.number, what)
        except ProcessLookupError:
            return  # it ended meanwhile, which is what was wanted


def find_process(number: int) -> Process | None:
    """Give the process that has a number now, or None where there is none."""
    born = _born(number)
    return None if born is None else Process(number, born)


def _born(number: int) -> str | None:
    """Say when the process of a number began; None where there is none, or it has ended."""
    if number <= 0:
        return None
    if os.name == "nt":
        return _born_on_windows(number)
    return _born_on_linux(number) if sys.platform == "linux" else _born_by_ps(number)


def _born_on_linux(number: int) -> str | None:
    """Ask /proc: ticks since this boot, and which boot."""
    try:
        told = Path(f"/proc/{number}/stat").read_text(encoding="utf-8", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except (FileNotFoundError, ProcessLookupError):
        return None
    after_name = told.rpartition(")")[2].split()  # the name may hold anything, blanks and brackets too
    return None if after_name[0] in ENDED else f"{boot} {after_name[19]}"


def _born_by_ps(number: int) -> str | None:
    """Ask `ps`, which every other POSIX system has; one without it can tell nothing."""
    try:
        done = subprocess.run(  # noqa: S603  (`ps`, wherever the system has it, and a number)
            ["ps", "-o", "stat=,lstart=", "-p", str(number)],
            check=False,
            capture_output=True,
            text=True,
            timeout=ASK_TIME_LIMIT_S,
            env={**os.environ, "LC_ALL": "C"},
            stdin=subprocess.DEVNULL,
        )
    except (FileNotFoundError, subprocess.TimeoutExpired):
        return None
    state, _, begun = done.stdout.strip().partition(" ")
    return begun.strip() if begun and not state.startswith(ENDED) else None


def _born_on_windows(number: int) -> str | None:
    """Ask the kernel: hundreds of nanoseconds since 1601."""
    import ctypes  # noqa: PLC0415
    from ctypes import wintypes  # noqa: PLC0415

    may_ask, still_active = 0x1000, 259  # PROCESS_QUERY_LIMITED_INFORMATION, STILL_ACTIVE
    kernel = ctypes.WinDLL("kernel32", use_last_error=True)  # type: ignore[attr-defined]
    kernel.OpenProcess.restype = wintypes.HANDLE
    handle = kernel.OpenProcess(may_ask, False, number)
    if not handle:
        return None
    try:
        code, times = wintypes.DWORD(), [wintypes.FILETIME() for _ in range(4)]
        handle = wintypes.HANDLE(handle)
        if not kernel.GetExitCodeProcess(handle, ctypes.byref(code)) or code.value != still_active:
            return None
        if not kernel.GetProcessTimes(handle, *map(ctypes.byref, times)):
            return None
        return str((times[0].dwHighDateTime << 32) + times[0].dwLowDateTime)
    finally:
        kernel.CloseHandle(handle)
