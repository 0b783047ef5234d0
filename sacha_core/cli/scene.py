"""`sacha scene`: a head or an avatar as plain arrays in a folder, for a program that only shows them, such as the Blender add-on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeInt, MaybePath
from sacha_core.cli.console import Console
from sacha_core.errors import OptionError
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.scene.contents import Scene

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Extras", "Options", "of_model", "open_scene", "run"]

INPUTS = ("file", "compare", "scores", "scheme", "motion")
OUTPUT_FOLDERS = ("out",)


@dataclass(frozen=True)
class Options:
    """Lay out an avatar or a head as arrays: for each triangle and each region what it carries, what it costs, and what decided so."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """An avatar (.sacha, a PLY of bound Gaussians, a model folder), a capture, a head (.npz, .pkl) or a mesh (.obj, .ply, .glb)."""

    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Where the arrays go."""

    compare: Annotated[MaybePath, tyro.conf.arg(metavar="AVATAR", help_behavior_hint="")] = None
    """Another avatar of the same head: also tell what FILE has more or less of than it, triangle by triangle and region by region."""

    scores: Annotated[FileOption, tyro.conf.arg(help_behavior_hint="(default: FILE.scores.npz beside it)")] = None
    """What `sacha score` or training wrote of an avatar: sensitivities, and each region's modulator, threshold and pruning ratio."""

    scheme: FileOption = None
    """Regions of one's own (.scheme.npz) instead of the avatar's."""

    measure: Annotated[MaybeInt, tyro.conf.arg(metavar="VIEWS", help_behavior_hint="")] = None
    """First measure an avatar in so many views, as `sacha score` does, and keep the scores beside it, or where --scores says."""

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

    if options.measure is not None:
        from sacha_core.cli import score

        measured = score.Options(options.file, options.scores, options.motion, views=options.measure, head=options.head)
        score.run(measured, console)
    console.report(Progress("read", 0, 2))
    named = Extras(options.scores, options.compare, options.scheme, options.motion)
    scene = open_scene(options.file, options.head, named)
    console.report(Progress("write", 1, 2))
    write_scene(scene, options.out)
    console.report(Progress("write", 2, 2))
    console.wrote("scene", options.out)
    return {
        "kind": scene.kind,
        "facts": scene.facts,
        "notes": scene.notes,
        "absent": scene.absent,
        "views": sorted(scene.views),
        "out": options.out,
    }


@dataclass(frozen=True)
class Extras:
    """What may be named besides a file.

    Args:
        scores: scores file of an avatar; None looks beside it.
        compare: another avatar of the same head.
        scheme: file of regions.
        motion: that the head shall have instead of the file's own.
    """

    scores: Path | None = None
    compare: Path | None = None
    scheme: Path | None = None
    motion: Path | None = None


def open_scene(path: Path, source: HeadSource, extras: Extras | None = None) -> Scene:
    """Read whatever a user names: an avatar, a capture, a head model, or a head's mesh.

    Args:
        path: the file, or the folder of a model or a capture.
        source: the head that it is bound to, or whose triangles a mesh has, where the file does not say it itself.
        extras: what else was named.

    Raises:
        SachaError: the file is damaged, or its head is missing or another one; or what was named besides does not belong to it.
        OSError: it cannot be read.
    """
    from sacha_core.cli.mesh_scene import open_mesh_scene
    from sacha_core.cli.showing import regions_of, scene_of_opened
    from sacha_core.cli.sources import capture_head, keep, open_avatar, open_motion, with_coordinates
    from sacha_core.flame.open import open_head
    from sacha_core.interchange.capture import is_capture, read_capture
    from sacha_core.interchange.head_mesh import SUFFIXES
    from sacha_core.scene.contents import scene_of_capture, scene_of_head

    extras = extras or Extras()
    suffix = path.suffix.lower()
    of_capture, of_head = path.is_dir() and is_capture(path), suffix in {".npz", ".pkl"}
    of_mesh = suffix in SUFFIXES and not (suffix == ".ply" and _holds_gaussians(path))
    if not (of_capture or of_head or of_mesh):
        return scene_of_opened(path, open_avatar(of_model(path), source, extras.motion), source, extras)
    if extras.compare is not None or extras.scores is not None:
        raise OptionError(f"{path} is no avatar: --compare and --scores are for avatars")
    if of_capture:
        capture = read_capture(path)
        head = with_coordinates(capture_head(capture, source))
        given = capture if extras.motion is None else replace(capture, motion=open_motion(extras.motion, head))
        return scene_of_capture(path.name, given, head, regions_of(extras.scheme, head))
    if of_mesh:
        return open_mesh_scene(path, source, extras.motion, extras.scheme)
    head = with_coordinates(open_head(str(path), masks=source.masks))
    keep(head)
    motion = None if extras.motion is None else open_motion(extras.motion, head)
    return scene_of_head(head, motion, regions_of(extras.scheme, head))


def of_model(path: Path) -> Path:
    """Give the folder of a trained model's iteration for its Gaussians' PLY: its motion and the name of its head lie around it."""
    is_of_model = path.name == "point_cloud.ply" and path.parent.parent.name == "point_cloud"
    return path.parent if is_of_model else path


def _holds_gaussians(path: Path) -> bool:
    """Tell a PLY of Gaussians from one of a mesh, by its header: only Gaussians have an opacity."""
    with path.open("rb") as file:
        header, _, _ = file.read(1 << 16).partition(b"end_header")
    return b" opacity" in header
