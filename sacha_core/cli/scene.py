"""`sacha scene`: a head or an avatar as plain arrays in a folder, for a program that only shows them, such as the Blender add-on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource
from sacha_core.cli.console import Console, kilobytes
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.scene.contents import Scene

__all__ = ["INPUTS", "Options", "open_scene", "run"]

INPUTS = ("file", "motion")


@dataclass(frozen=True)
class Options:
    """Lay out an avatar or a head as arrays, with the region and the number of Gaussians of each triangle."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """An avatar (.sacha, a PLY of bound Gaussians, a model folder), a capture, a head (.npz, .pkl) or a mesh (.obj, .ply, .glb)."""

    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Where the arrays go."""

    motion: FileOption = None
    """A motion (.npz) that the head shall have instead of the file's own."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Read the file, write the folder.

    Raises:
        SachaError: the file is damaged, or its head is missing or another one.
        OSError: a file cannot be read or written.
    """
    from sacha_core.scene.folder import write_scene

    console.report(Progress("read", 0, 2))
    scene = open_scene(options.file, options.head, options.motion)
    console.report(Progress("write", 1, 2))
    write_scene(scene, options.out)
    console.report(Progress("write", 2, 2))
    console.wrote("scene", options.out)
    return {"kind": scene.kind, "facts": scene.facts, "notes": scene.notes, "out": options.out}


def open_scene(path: Path, source: HeadSource, motion: Path | None = None) -> Scene:
    """Read whatever a user names: an avatar, a capture, a head model, or a head's mesh.

    Args:
        path: the file, or the folder of a model or a capture.
        source: the head that it is bound to, or whose triangles a mesh has, where the file does not say it itself.
        motion: file of a motion that the head shall have instead of the file's own.

    Raises:
        SachaError: the file is damaged, or its head is missing or another one.
        OSError: it cannot be read.
    """
    from sacha_core.cli.sources import capture_head, named_head, open_avatar, open_motion, with_coordinates
    from sacha_core.flame.open import open_head
    from sacha_core.interchange.capture import is_capture, read_capture
    from sacha_core.interchange.head_mesh import SUFFIXES, read_head_mesh
    from sacha_core.scene.contents import scene_of_avatar, scene_of_capture, scene_of_head, scene_of_mesh

    suffix = path.suffix.lower()
    if path.is_dir() and is_capture(path):
        capture = read_capture(path)
        head = with_coordinates(capture_head(capture, source))
        given = capture if motion is None else replace(capture, motion=open_motion(motion, head))
        return scene_of_capture(path.name, given, head)
    if suffix in {".npz", ".pkl"}:
        head = with_coordinates(open_head(str(path), masks=source.masks))
        return scene_of_head(head, None if motion is None else open_motion(motion, head))
    if suffix in SUFFIXES and not (suffix == ".ply" and _holds_gaussians(path)):
        mesh, named = read_head_mesh(path), named_head(source)
        if named is None:
            return scene_of_mesh(path.stem, mesh, None)
        moved = None if motion is None else open_motion(motion, named)
        return scene_of_mesh(path.stem, mesh, with_coordinates(named), moved)
    opened = open_avatar(_of_model(path), source, motion)
    scene = scene_of_avatar(path.stem, opened.avatar, with_coordinates(opened.head))
    return replace(scene, facts=[*scene.facts, kilobytes(path.stat().st_size)]) if path.is_file() else scene


def _of_model(path: Path) -> Path:
    """Give the folder of a trained model's iteration for its Gaussians' PLY: its motion and the name of its head lie around it."""
    is_of_model = path.name == "point_cloud.ply" and path.parent.parent.name == "point_cloud"
    return path.parent if is_of_model else path


def _holds_gaussians(path: Path) -> bool:
    """Tell a PLY of Gaussians from one of a mesh, by its header: only Gaussians have an opacity."""
    with path.open("rb") as file:
        header, _, _ = file.read(1 << 16).partition(b"end_header")
    return b" opacity" in header
