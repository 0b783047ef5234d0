"""`sacha decode`: a .sacha file back into files that others read."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybePath
from sacha_core.cli.console import Console, counted, kilobytes
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.avatar.motion import Motion

__all__ = ["INPUTS", "ITERATION", "OUTPUTS", "OUTPUT_FOLDERS", "Options", "require_room", "run"]

INPUTS = ("file",)
OUTPUTS = ("ply", "motion")
OUTPUT_FOLDERS = ("model",)

ITERATION = 1  # a folder of a model names its iterations; a decoded avatar has had none that are known


@dataclass(frozen=True)
class Options:
    """Turn a .sacha file back into a PLY of bound Gaussians, a motion, or a model folder as GaussianAvatars has it.

    sacha decode a.sacha --ply back.ply --motion motion.npz
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE.sacha")]
    """The file."""

    ply: FileOption = None
    """Write the Gaussians here, local to the triangles that `binding_0` names, with harmonics of the degree that they have."""

    motion: Annotated[MaybePath, tyro.conf.arg(aliases=["--flame-param"], metavar="FILE", help_behavior_hint="")] = None
    """Write the motion here, as GaussianAvatars' flame_param.npz."""

    model: Annotated[MaybePath, tyro.conf.arg(metavar="MODEL", help_behavior_hint="")] = None
    """Write both into this folder, in the layout of a GaussianAvatars model."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Decode the file and write what was asked for.

    Raises:
        SachaError: the file is damaged, or its head is needed and not to be found.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import decode_file
    from sacha_core.interchange.capture import write_head_reference
    from sacha_core.interchange.gaussian_avatars import write_flame_param, write_model
    from sacha_core.interchange.splat_ply import write_bound_ply

    if options.ply is None and options.motion is None and options.model is None:
        raise OptionError("expected --ply FILE, --motion FILE or --model FOLDER: where the avatar shall go")
    avatar = decode_file(options.file, options.head)
    if options.motion is not None and avatar.motion is None:
        raise OptionError(f"{options.file} has no motion that --motion could write")
    if options.model is not None:
        require_room("--model", options.model, avatar.motion)
    console.say(
        f"{options.file}: {counted(len(avatar.gaussians), 'Gaussian')} on head {avatar.head.name!r}, "
        + (counted(len(avatar.motion), "frame") if avatar.motion else "no motion")
    )
    if options.ply is not None:
        write_bound_ply(options.ply, avatar.gaussians, avatar.gaussians.sh_degree)
        console.wrote("gaussians", options.ply, kilobytes(options.ply.stat().st_size))
    if options.motion is not None and avatar.motion is not None:
        write_flame_param(options.motion, avatar.motion)
        console.wrote("motion", options.motion, kilobytes(options.motion.stat().st_size))
    if options.model is not None:
        write_head_reference(options.model, avatar.head)
        write_model(options.model, ITERATION, avatar.gaussians, avatar.motion)
        console.wrote("model", options.model)
    return {
        "file": options.file,
        "n_gaussians": len(avatar.gaussians),
        "n_frames": 0 if avatar.motion is None else len(avatar.motion),
        "head": asdict(avatar.head),
        "ply": options.ply,
        "motion": options.motion,
        "model": options.model,
    }


def require_room(option: str, folder: Path, motion: Motion | None) -> None:
    """Check that nothing in a folder stands before the model that will be written there.

    Args:
        option: that names the folder.
        folder: need not exist.
        motion: of the avatar.

    Raises:
        OptionError: a later iteration, which every program would open instead, or the motion of another avatar.
    """
    from sacha_core.interchange.gaussian_avatars import PARAMETERS_NAME, model_iterations

    held = model_iterations(folder)
    last = max(held, default=ITERATION)
    if last > ITERATION:
        raise OptionError(
            f"{option} {folder} holds iteration {last} of a model, which would be opened instead; expected another folder"
        )
    if motion is None and ITERATION in held and (held[ITERATION] / PARAMETERS_NAME).exists():
        raise OptionError(
            f"{option} {folder} holds the motion of a model, and this avatar has none to put there; expected another folder"
        )
