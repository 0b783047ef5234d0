"""`sacha splats`: an avatar's Gaussians as point attributes in a folder, for a program that shows splats, such as the Blender add-on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource, MaybePath
from sacha_core.cli.console import Console
from sacha_core.progress import Progress

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run"]

INPUTS = ("avatar", "vertices")
OUTPUT_FOLDERS = ("out",)


@dataclass(frozen=True)
class Options:
    """Lay out an avatar's Gaussians as arrays, in a pose and in the frames of their triangles, z up."""

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Where the arrays go."""

    frame: int = 0
    """Frame of the avatar's motion that they are posed by."""

    vertices: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.npy", help_behavior_hint="")] = None
    """Posed vertices (v, 3) of the head, metres, y up, instead of a frame."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Read the avatar, write the folder.

    Raises:
        SachaError: the avatar is damaged, its head missing, or the pose not its head's.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.posing import posed_frames
    from sacha_core.cli.sources import open_avatar
    from sacha_core.scene.splats import splats_of, write_splats

    console.report(Progress("read", 0, 2))
    opened = open_avatar(options.avatar, options.head)
    frames = posed_frames(opened, options.frame, options.vertices)
    console.report(Progress("write", 1, 2))
    splats = splats_of(opened.avatar.gaussians, frames)
    write_splats(splats, options.out)
    console.report(Progress("write", 2, 2))
    console.wrote("splats", options.out, f"{len(splats.binding):,} Gaussians")
    return {"n_gaussians": len(splats.binding), "n_faces": splats.n_faces, "sh_degree": splats.sh_degree}
