"""`sacha scene`: a head or an avatar as plain arrays in a folder, for a program that only shows them, such as the Blender add-on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource
from sacha_core.cli.console import Console
from sacha_core.progress import Progress

__all__ = ["INPUTS", "Options", "run"]

INPUTS = ("file",)


@dataclass(frozen=True)
class Options:
    """Lay out an avatar or a head as arrays, with the region and the number of Gaussians of each triangle."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """An avatar (.sacha, a PLY of bound Gaussians, a model folder), a head model (.npz, .pkl) or a head's mesh (.obj, .ply)."""

    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Where the arrays go."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Read the file, write the folder.

    Raises:
        SachaError: the file is damaged, or its head is missing or another one.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.scene_contents import open_scene, write_scene

    console.report(Progress("read", 0, 2))
    scene = open_scene(options.file, options.head)
    console.report(Progress("write", 1, 2))
    write_scene(scene, options.out)
    console.report(Progress("write", 2, 2))
    console.wrote("scene", options.out)
    return {"kind": scene.kind, "facts": scene.facts, "notes": scene.notes, "out": options.out}
