# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine: which Python has it, and the commands that the add-on gives to it. Knows nothing of Blender."""

from __future__ import annotations

import json
import os
from pathlib import Path

__all__ = ["EngineMissingError", "command", "describe", "find_python", "probe"]

VARIABLE = "SACHA_ENGINE"

# Runs in the engine's Python, which may lack everything: it must answer even then.
PROBE = """
import importlib.metadata as m, json, platform
def version(name):
    try: return m.version(name)
    except m.PackageNotFoundError: return None
print(json.dumps({"python": platform.python_version(), **{n: version(n) for n in ("sacha", "numba", "constriction")}}))
"""


class EngineMissingError(Exception):
    """No usable Python is named; the message says how to name one."""


def find_python(named: str) -> Path:
    """Give the Python that runs the engine: the one named in the preferences, else the one in SACHA_ENGINE.

    Args:
        named: what the preferences say, absolute; empty where nothing was chosen.

    Raises:
        EngineMissingError: none is named, or what is named is no file.
    """
    choice = named or os.environ.get(VARIABLE, "")
    if not choice:
        raise EngineMissingError("No SACHA engine: name the Python that has it in the add-on's preferences")
    if not Path(choice).is_file():
        raise EngineMissingError(
            f"No SACHA engine at {choice}: name the Python that has it in the add-on's preferences"
        )
    return Path(choice)


def command(python: Path, *arguments: str | os.PathLike[str]) -> list[str]:
    """Give the command line of one engine command that reports its progress line by line."""
    return [str(python), "-m", "sacha_core", *map(os.fspath, arguments), "--progress", "json"]


def probe(python: Path) -> list[str]:
    """Give the command line that asks a Python what it has; it prints one JSON object."""
    return [str(python), "-c", PROBE]


def describe(printed: str) -> str:
    """Say in a sentence what the probe found.

    Args:
        printed: what the probe wrote.

    Raises:
        EngineMissingError: this Python has no engine.
    """
    found = json.loads(printed.strip().splitlines()[-1])
    python = f"Python {found.pop('python')}"
    if found["sacha"] is None:
        raise EngineMissingError(f"{python} without SACHA: install it there with pip")
    missing = [name for name, version in found.items() if version is None]
    if missing:
        raise EngineMissingError(f"{python} with SACHA {found['sacha']}, but without {' and '.join(missing)}")
    return f"{python}, SACHA {found['sacha']}"
