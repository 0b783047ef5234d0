"""`sacha export`: an avatar as files for viewers, engines and the web."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource
from sacha_core.cli.console import Console
from sacha_core.errors import OptionError

__all__ = ["INPUTS", "FormatName", "Options", "run"]

INPUTS = ("avatar", "motion")

FormatName = Literal["ply"]


@dataclass(frozen=True)
class Options:
    """Write an avatar in the formats of other programs, frame by frame where they know no motion.

    sacha export a.sacha --format ply --frames 12 -o frame.ply

    sacha export a.sacha --format ply --frames 0:100:2 -o FOLDER
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE")]
    """The file to write; for several frames a folder, in which each is called by its number: 00012.ply."""

    format: FormatName = "ply"
    """ply: Gaussians in the world as 3D Gaussian Splatting has them, which every splat viewer opens."""

    frames: Annotated[str, tyro.conf.arg(metavar="FRAMES")] = "0"
    """One frame (12), or a slice as in Python (0:100, ::2, all of them with a lone colon)."""

    motion: FileOption = None
    """Motion (.npz) to take the frames from instead of the avatar's own."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Write what was asked for.

    Raises:
        SachaError: the avatar, its head or the options make no sense.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.exporting import FORMATS
    from sacha_core.cli.sources import open_avatar

    assert set(FORMATS) == set(get_args(FormatName))
    chosen = FORMATS[options.format]
    if not chosen.by_frame and options.frames != Options.frames:
        raise OptionError(f"--frames is for formats of single frames; {options.format} has none")
    opened = open_avatar(options.avatar, options.head, options.motion)
    written = chosen.write(opened, options.output, options.frames, console)
    total = sum(path.stat().st_size for path in written)
    return {"format": options.format, "files": [str(path) for path in written], "bytes": total, **facts(opened)}


def facts(opened: Any) -> dict[str, Any]:
    """Give what the report says of the avatar."""
    motion = opened.avatar.motion
    return {"n_gaussians": len(opened.avatar.gaussians), "n_frames": len(motion) if motion else 0}
