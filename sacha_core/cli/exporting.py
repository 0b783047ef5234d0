"""The formats of `sacha export`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sacha_core.animation.standing import Standing
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.cli.console import Console, kilobytes
from sacha_core.cli.render import frame_range
from sacha_core.cli.sources import Opened
from sacha_core.errors import OptionError
from sacha_core.interchange.splat_ply import write_world_ply
from sacha_core.progress import Progress

__all__ = ["FORMATS", "Format"]

Write = Callable[[Opened, Path, str, Console], list[Path]]


@dataclass(frozen=True)
class Format:
    """One format to export to.

    Args:
        write: writes an avatar there, the frames that a text names, and gives the files.
        by_frame: whether a file of it holds one frame, so that frames can be chosen.
    """

    write: Write
    by_frame: bool = False


def each_frame(suffix: str, write_one: Callable[[Path, Gaussians], None]) -> Format:
    """Give the format whose files each hold the Gaussians of one frame."""

    def write(opened: Opened, output: Path, frames: str, console: Console) -> list[Path]:
        standing = Standing(opened.avatar.gaussians, opened.head, opened.avatar.motion)
        chosen = chosen_frames(frames, len(standing))
        paths = frame_paths(output, chosen, suffix)
        for done, (frame, path) in enumerate(zip(chosen, paths, strict=True), start=1):
            write_one(path, standing(frame))
            console.report(Progress("write", done, len(chosen)))
        many = f"{len(paths)} frames, " if len(paths) > 1 else f"frame {chosen[0]}, "
        total = sum(path.stat().st_size for path in paths)
        console.wrote("splats", output, f"{many}{len(opened.avatar.gaussians):,} Gaussians, {kilobytes(total)}")
        return paths

    return Format(write, by_frame=True)


def chosen_frames(text: str, n_frames: int) -> range:
    """Give the frames that `12` or a slice such as `0:100:2` names.

    Raises:
        OptionError: it is neither, or names no frame.
    """
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


FORMATS = {"ply": each_frame(".ply", write_world_ply)}
