# SPDX-License-Identifier: GPL-3.0-or-later
"""What to do about each kind of problem, in an artist's words. Knows nothing of Blender.

A kind is the class of the engine's error (`sacha_core/errors.py`; the engine names it when a command fails), or one that the add-on finds.
"""

from __future__ import annotations

import re

__all__ = ["ADVICE", "advice", "in_blender"]

INSTALL = 'pip install "sacha[shell]"'
UPGRADE = 'pip install --upgrade "sacha[shell]"'

ADVICE = {
    # found by the add-on
    "NoEngine": f"To have one, run: {INSTALL} with any Python 3.11 or newer, and name that Python in the preferences",
    "EngineTooOld": f"Update it: run {UPGRADE} with that Python",
    "EngineTooNew": "Update the add-on: Preferences > Get Extensions > Install from Disk, with the zip of that version",
    "EngineKilled": "Perhaps memory ran out: close other programs, and try again",
    "EngineBroken": "That is a fault of SACHA, not yours: Copy Diagnostics, and send them to its authors",
    "OutOfTime": "Raise the Time Limit in the add-on's preferences, and try again",
    "StaleWorker": "Start it again; what was finished before is kept, and found again",
    "Unreadable": "Try again; if it comes back, Copy Diagnostics, and send them to SACHA's authors",
    # told by the engine
    "MissingHeadError": "Choose its head model under Head. FLAME is licensed and no part of SACHA: get yours at flame.is.tue.mpg.de",
    "MissingMasksError": "Choose FLAME_masks.pkl or .npz under Masks. It is licensed with FLAME: get it at flame.is.tue.mpg.de",
    "TopologyError": "Choose the head that it was made with under Head; a mesh keeps that head's vertices and triangles, in their order",
    "VersionError": f"If it is newer, update the engine: run {UPGRADE} with its Python; if it is older, encode it again from its avatar",
    "ModuleNotFoundError": "Run that with the engine's Python, and try again",
    "FormatError": "The file is damaged, cut short, or of another kind: get it again from where it came",
    "FileNotFoundError": "Choose the file again: it was moved, renamed or removed",
    "PermissionError": "Choose a folder that you may write to",
    "DatasetError": "Choose the dataset's own folder, the one that holds its transforms",
}

# What the command line says of its options has another name in Blender; `advice` says it.
OF_THE_SHELL = re.compile(
    r"[;:] (name it with --head \w+|--no-rendering encodes it without posing the head|see sacha [\w-]+ --help)$"
)


def advice(kind: str) -> str:
    """Give a sentence that says what to do; empty where the message alone says it."""
    return ADVICE.get(kind, "")


def in_blender(message: str) -> str:
    """Give a message of the engine without what it says of the command line."""
    return OF_THE_SHELL.sub("", message.strip())
