"""The formats of `sacha export`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sacha_core.animation.standing import Standing, standing_on
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.console import Console, kilobytes
from sacha_core.cli.decode import ITERATION, require_room
from sacha_core.cli.posing import read_vertices
from sacha_core.cli.render import frame_range
from sacha_core.cli.skin_picture import skin_picture
from sacha_core.cli.sources import Opened
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers.peer import enlarged
from sacha_core.evaluate.peers.splat_transform import lacking, transform
from sacha_core.files import require_writable, require_writable_folder, write_aside
from sacha_core.flame.model import JOINTS
from sacha_core.flame.teeth import is_flame
from sacha_core.flame.unwrap import unwrapped
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import HEAD_JSON, write_head_reference
from sacha_core.interchange.gaussian_avatars import (
    ARGUMENTS_NAME,
    PARAMETERS_NAME,
    PLY_NAME,
    for_their_viewer,
    write_model,
)
from sacha_core.interchange.gltf_head import write_gltf_head
from sacha_core.interchange.gltf_splats import write_gltf_splats
from sacha_core.interchange.splat_ply import write_world_ply
from sacha_core.interchange.y_down import turned_over
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.cli.export import Options

__all__ = ["FORMATS", "Format", "require_consistent"]

SPZ_ENLARGED = 16.0  # SPZ rounds places to 1/4096 of a unit, a quarter of a millimetre were the unit a metre
FILE_ENDINGS = frozenset({".ply", ".glb", ".gltf", ".spz", ".obj", ".npz", ".sacha", ".txt", ".zip"})


@dataclass(frozen=True)
class Format:
    """One format to export to.

    Args:
        write: writes an avatar as the options say, and gives the files.
        suffix: how the name of such a file ends; empty for a folder.
        takes: options that it has a use for, beside those that all have.
        enlarge: by how much it enlarges where nobody says.
    """

    write: Callable[[Opened, Options, Console], list[Path]]
    suffix: str
    takes: tuple[str, ...] = ()
    enlarge: float = 1.0


def require_consistent(options: Options) -> None:
    """Check that every option that was given has a part in what will be written.

    Raises:
        OptionError: naming the first that has none, or that makes no sense.
    """
    if options.texture is not None and options.scheme is not None:
        raise OptionError("--texture and --scheme both say what the skin shows; expected one of them")
    chosen = FORMATS[options.format]
    usual = type(options)
    for name in ("frames", "vertices", "y_down", "enlarge", "texture", "scheme"):
        if getattr(options, name) != getattr(usual, name) and name not in chosen.takes:
            able = " and ".join(sorted(other for other, format_ in FORMATS.items() if name in format_.takes))
            raise OptionError(f"--{name.replace('_', '-')} is for {able}; --format {options.format} has no use for it")
    require_name(options.output, chosen.suffix, options.format)
    if options.enlarge is not None and not 1e-3 <= options.enlarge <= 1e6:
        raise OptionError(f"--enlarge is {options.enlarge:g}, expected a factor between 0.001 and a million")


def require_name(output: Path, suffix: str, name: str) -> None:
    """Check that the name of what will be written does not say that it is something else.

    Raises:
        OptionError: it ends as files of another format do.
    """
    ending = output.suffix.lower()
    if ending != suffix and ending in FILE_ENDINGS:
        expected = f"a name that ends in {suffix}" if suffix else "the name of a folder"
        raise OptionError(f"-o {output}: --format {name} is not written into a {ending} file; expected {expected}")


def each_frame(
    suffix: str, write_one: Callable[[Path, Gaussians], None], takes: tuple[str, ...] = (), enlarge: float = 1.0
) -> Format:
    """Give the format whose files each hold the Gaussians of one frame."""

    def write(opened: Opened, options: Options, console: Console) -> list[Path]:
        frames, standing = poses(opened, options)
        paths = frame_paths(options.output, frames, suffix)
        for path in paths:
            require_writable(path)
        factor = enlarge if options.enlarge is None else options.enlarge
        for done, (frame, path) in enumerate(zip(frames, paths, strict=True), start=1):
            gaussians = standing(frame)
            if factor != 1:
                gaussians = enlarged(gaussians, factor)
            write_one(path, turned_over(gaussians) if options.y_down else gaussians)
            console.report(Progress("write", done, len(frames)))
        many = f"{len(paths)} frames, " if len(paths) > 1 else f"frame {frames[0]}, "
        size = f", {factor:g} times as large as life" if factor != 1 else ""
        total = sum(path.stat().st_size for path in paths)
        told = f"{many}{len(opened.avatar.gaussians):,} Gaussians, {kilobytes(total)}{size}"
        console.wrote("splats", options.output, told)
        return paths

    return Format(write, suffix, ("frames", "vertices", "enlarge", *takes), enlarge)


def poses(opened: Opened, options: Options) -> tuple[range, Callable[[int], Gaussians]]:
    """Give the frames that are written, and what gives the Gaussians of each; a posed mesh is frame 0.

    Raises:
        SachaError: the avatar does not move as its head does, or there is no such frame or mesh.
        OSError: the mesh cannot be read.
    """
    if options.vertices is None:
        standing = Standing(opened.avatar.gaussians, opened.head, opened.avatar.motion)
        if opened.avatar.motion is None and options.frames is not None:
            require_at_rest(options.frames)
        return chosen_frames(options.frames or "0", len(standing)), standing
    if options.frames is not None:
        raise OptionError("--frames and --vertices both say how the head is posed; expected one of them")
    frames = triangle_frames(read_vertices(options.vertices, opened.head), opened.head.faces)
    return range(1), lambda _: standing_on(opened.avatar.gaussians, frames)


def require_at_rest(text: str) -> None:
    """Check that no more is asked for of an avatar without a motion than the one frame that it has; a slice would hide that.

    Raises:
        OptionError: there are other frames among those that were named.
    """
    if any(part.isdecimal() and int(part) > place for place, part in enumerate(text.split(":")[:2])):
        raise OptionError(
            f"--frames {text}: the avatar has no motion, and so 1 frame, 0: the head at rest; --motion FILE puts one in"
        )


def chosen_frames(text: str, n_frames: int) -> range:
    """Give the frames that `12` or a slice such as `0:100:2` names.

    Raises:
        OptionError: it is neither, or names no frame.
    """
    if not n_frames:
        raise OptionError(f"--frames {text}: the avatar has no motion to take frames from; --motion FILE puts one in")
    if ":" in text:
        return frame_range(text, n_frames)
    if not text.isdecimal() or int(text) >= n_frames:
        raise OptionError(
            f"--frames {text}: expected a frame from 0 to {n_frames - 1}, or FROM:TO such as 0:100 or ::2"
        )
    return range(int(text), int(text) + 1)


def frame_paths(output: Path, frames: range, suffix: str) -> list[Path]:
    """Give the file of each frame: `output` where it is named as a file, which only one frame can be; else one for each in that folder.

    Raises:
        OptionError: several frames were to go into one file.
    """
    if output.suffix.lower() != suffix:
        return [output / f"{frame:05d}{suffix}" for frame in frames]
    if len(frames) > 1:
        raise OptionError(f"-o {output} is one file, and {len(frames)} frames were asked for; expected a folder")
    return [output]


def write_spz(path: Path, gaussians: Gaussians) -> None:
    """Write Niantic's SPZ by PlayCanvas' program, which takes a PLY and turns it over, since SPZ's y is up.

    Raises:
        OptionError: the program is missing.
        ProgramError: it failed.
        OSError: a file cannot be written.
    """
    lack = lacking()
    if lack is not None:
        raise OptionError(f"--format spz {lack}")
    with tempfile.TemporaryDirectory() as name, write_aside(path) as aside:
        write_world_ply(Path(name) / "in.ply", turned_over(gaussians), gaussians.sh_degree)
        transform(Path(name), "in.ply", "out.spz")
        aside.write_bytes((Path(name) / "out.spz").read_bytes())


def write_head(opened: Opened, options: Options, console: Console) -> list[Path]:
    """Write the head and its motion as glTF, with the map of its regions on the skin where they are known."""
    require_writable(options.output)
    head = unwrapped(opened.head)
    motion = opened.avatar.motion or Motion.rest(0, head.exprdirs.shape[2], 0)
    if options.frames is not None:
        motion = motion.frames(np.array(chosen_frames(options.frames, len(motion))))
    picture, shown = skin_picture(head, options.texture, options.scheme, opened.avatar.scheme)
    write_gltf_head(options.output, head, motion, motion.frame_rate, picture)
    size = kilobytes(options.output.stat().st_size)
    console.wrote("head", options.output, f"{len(motion)} frames, {shown}, {size}")
    return [options.output]


def write_their_model(opened: Opened, options: Options, console: Console) -> list[Path]:
    """Write a model folder for GaussianAvatars' own programs.

    Raises:
        OptionError: the folder holds what would be taken for this model, or for its motion.
        OSError: a file cannot be written.
    """
    motion, head = opened.avatar.motion, opened.head
    require_room("-o", options.output, motion)
    require_writable_folder(options.output)
    theirs = is_flame(head) and len(head.parents) == len(
        JOINTS
    )  # a rig of FLAME's mesh may have other shapes and no jaw
    if motion is not None and theirs:
        motion = for_their_viewer(motion)
    write_head_reference(options.output, opened.avatar.head)
    folder = write_model(options.output, ITERATION, opened.avatar.gaussians, motion)
    console.wrote("model", options.output, f"{len(opened.avatar.gaussians):,} Gaussians")
    if not theirs:
        console.say(
            f"note         GaussianAvatars' programs pose FLAME alone, not {head.name!r}; sacha reads the folder as it is"
        )
    elif motion is None:
        console.say("note         GaussianAvatars' programs want a motion, too: --motion FILE puts one in")
    written = [options.output / HEAD_JSON, options.output / ARGUMENTS_NAME, folder / PARAMETERS_NAME, folder / PLY_NAME]
    return written if motion is not None else [path for path in written if path.name != PARAMETERS_NAME]


FORMATS = {
    "ply": each_frame(".ply", write_world_ply, ("y_down",)),
    "gltf-splats": each_frame(".glb", write_gltf_splats),
    "spz": each_frame(".spz", write_spz, enlarge=SPZ_ENLARGED),
    "gltf-head": Format(write_head, ".glb", ("frames", "texture", "scheme")),
    "gaussian-avatars": Format(write_their_model, ""),
}
