"""`sacha export`: an avatar as files for viewers, engines and the web."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeFloat, MaybePath, MaybeText
from sacha_core.cli.console import Console

__all__ = ["INPUTS", "FormatName", "Options", "run"]

INPUTS = ("avatar", "motion", "texture", "scheme", "vertices")

FormatName = Literal["ply", "gltf-splats", "spz", "gltf-head", "gaussian-avatars"]


@dataclass(frozen=True)
class Options:
    """Write an avatar in the formats of other programs.

    ply: Gaussians in the world as 3D Gaussian Splatting has them, which every splat viewer opens. gltf-splats: the same as a .glb with the
    extension KHR_gaussian_splatting. spz: the same as Niantic's SPZ, by the program splat-transform. gltf-head: the head's mesh as a plain
    .glb, with skin, blend shapes and its motion as an animation. gaussian-avatars: a model folder as their viewer opens it.

    sacha export a.sacha --format ply --frames 12 -o frame.ply

    sacha export a.sacha --format ply --frames 0:100:2 -o FOLDER
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE")]
    """The file to write; for several frames a folder, in which each is called by its number: 00012.ply."""

    format: FormatName = "ply"
    """What to write, see above."""

    frames: Annotated[MaybeText, tyro.conf.arg(metavar="FRAMES", help_behavior_hint="(default: 0; gltf-head all)")] = (
        None
    )
    """One frame (12), or a slice as in Python (0:100, ::2, all of them with a lone colon)."""

    vertices: Annotated[MaybePath, tyro.conf.arg(metavar="FILE.npy", help_behavior_hint="")] = None
    """Posed vertices (v, 3) of the head, metres, y up, instead of a frame of the motion."""

    texture: FileOption = None
    """With gltf-head: a PNG for the skin, by the head's texture coordinates, instead of the map of its regions."""

    y_down: bool = False
    """Turn a PLY over: for viewers that take it for y down, as 3D Gaussian Splatting's scenes are."""

    enlarge: Annotated[MaybeFloat, tyro.conf.arg(metavar="FACTOR", help_behavior_hint="(default: 1; SPZ 16)")] = None
    """How many times as large as life, which is in metres."""

    scheme: FileOption = None
    """With gltf-head: regions of one's own (.scheme.npz) for that map."""

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
    from sacha_core.cli.exporting import FORMATS, require_consistent
    from sacha_core.cli.sources import open_avatar

    require_consistent(options)
    opened = open_avatar(options.avatar, options.head, options.motion)
    written = FORMATS[options.format].write(opened, options, console)
    motion = opened.avatar.motion
    return {
        "format": options.format,
        "files": [str(path) for path in written],
        "bytes": sum(path.stat().st_size for path in written),
        "n_gaussians": len(opened.avatar.gaussians),
        "n_frames": len(motion) if motion else 0,
    }
