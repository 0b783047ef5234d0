"""`sacha assemble`: footage that another program rendered, such as Blender, as a capture that one trains on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource
from sacha_core.cli.console import Console
from sacha_core.errors import DatasetError, MissingHeadError
from sacha_core.progress import Progress

if TYPE_CHECKING:
    from sacha_core.flame.model import HeadModel
    from sacha_core.interchange.footage import Footage

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run"]

INPUTS = ("footage", "source")
OUTPUT_FOLDERS = ("output",)
HEAD_FILE = "head.npz"
TAG = "rendered"  # last part of the folder's name


@dataclass(frozen=True)
class Options:
    """Turn footage into a capture in GaussianAvatars' layout: pictures on white, masks, cameras, and parameters of each timestep."""

    footage: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOOTAGE")]
    """A folder with footage.json (see interchange/footage.py)."""

    source: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """What the filmed head was opened from: an avatar, a head model, or a mesh with --head."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]
    """Where the capture goes."""

    check: bool = False
    """Only check that the head stands where its parameters say, before the pictures are made."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Check the footage, and write the capture.

    Raises:
        SachaError: the footage is incomplete, or is not of this head.
        OSError: a file cannot be read or written.
    """
    from sacha_core.interchange.footage import read_footage, with_own_shape

    head = head_of(options.source, options.head)
    footage = with_own_shape(read_footage(options.footage), head)
    if len(footage.cameras) < 2:
        raise DatasetError(f"{options.footage} has one camera, expected at least two: one is held out to judge by")
    facts = {"n_timesteps": len(footage.motion), "n_cameras": len(footage.cameras), "head": head.name}
    if options.check:
        return facts
    folder = assemble(footage, head, options.output, console)
    console.wrote("capture", folder)
    console.hint(f"sacha train {folder} -o out/model")
    return {"capture": folder, "n_images": len(footage.views), **facts}


def head_of(path: Path, source: HeadSource) -> HeadModel:
    """Give the head that a mesh has which `sacha scene` opened from a file.

    Raises:
        SachaError: the file is damaged, or does not say which head it has and none is named.
        OSError: it cannot be read.
    """
    from sacha_core.cli.scene import of_model
    from sacha_core.cli.sources import capture_head, named_head, open_avatar
    from sacha_core.flame.open import open_head
    from sacha_core.interchange.capture import is_capture, read_capture

    if path.suffix.lower() in {".npz", ".pkl"}:
        return open_head(str(path), masks=source.masks)
    if path.is_dir() and is_capture(path):
        return capture_head(read_capture(path), source)
    avatar = of_model(path)
    if avatar.is_dir() or avatar.suffix.lower() == ".sacha":
        return open_avatar(avatar, source).head
    head = named_head(source)
    if head is None:
        raise MissingHeadError(f"{path} does not say which head it has: name it with --head HEAD")
    return head


def assemble(footage: Footage, head: HeadModel, root: Path, console: Console) -> Path:
    """Write the capture of checked footage; give its folder."""
    from sacha_core.cli.synth import subject_name
    from sacha_core.flame.head_file import save_head
    from sacha_core.interchange.capture_writer import CaptureWriter
    from sacha_core.interchange.footage import read_picture

    held_out = front_camera(footage)
    head_file = root / HEAD_FILE
    subject, take = subject_name(Path(footage.subject)), subject_name(Path(footage.take))
    writer = CaptureWriter(root, subject, head.reference, head_file, held_out, TAG, footage.origin)
    sequence = writer.sequence(take, footage.motion, footage.cameras)
    save_head(head, head_file)
    for done, view in enumerate(footage.views):
        console.report(Progress("write", done, len(footage.views)))
        picture, mask = read_picture(view)
        sequence.add(view.timestep, view.camera_index, view.camera, picture, mask)
    sequence.finish()
    console.report(Progress("write", len(footage.views), len(footage.views)))
    return sequence.folder


def front_camera(footage: Footage) -> int:
    """Give the camera that looks the face in the eye most nearly at the first timestep: the one held out, as in NeRSemble."""
    import numpy as np

    from sacha_core.geometry.rotation import rotation_vectors_to_matrices

    ahead = rotation_vectors_to_matrices(footage.motion.rotation[:1])[0, :, 2]
    middle = footage.posed[0].mean(axis=0) if len(footage.posed) else footage.motion.translation[0]
    first = [view for view in footage.views if view.timestep == 0]

    def facing(row: int) -> float:
        towards = first[row].camera.centre - middle
        return float(towards @ ahead / np.linalg.norm(towards))

    return first[max(range(len(first)), key=facing)].camera_index
