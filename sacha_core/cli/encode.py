"""`sacha encode`: an avatar and its motion into one small file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeFloat, MaybePath, MaybeText
from sacha_core.cli.console import Console, counted, kilobytes
from sacha_core.cli.inspect import grade
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.codec import Inspection

__all__ = ["INPUTS", "OUTPUTS", "Options", "run"]

MaybeWeights = Union[None, tuple[str, ...]]  # noqa: UP007 (None first: for a list tyro would load a type checker)

INPUTS = ("model", "ply", "motion", "scheme")
OUTPUTS = ("output",)


@dataclass(frozen=True)
class Options:
    """Compress an avatar and its motion into one .sacha file.

    The avatar is a model folder as `sacha train` and GaussianAvatars write it, or a PLY of bound Gaussians with its head:

    sacha encode MODEL -o a.sacha

    sacha encode --ply a.ply --head rig.npz --motion motion.npz -o a.sacha

    sacha encode MODEL --target-size 300KB -o a.sacha
    """

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.sacha")]
    """Where the compressed avatar goes."""

    model: Annotated[
        MaybePath, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL", help_behavior_hint="(or --ply)")
    ] = None
    """A model folder, or a .sacha file to compress anew."""

    ply: FileOption = None
    """Instead of a model folder: a PLY of Gaussians that are bound to triangles (`binding_0`)."""

    motion: FileOption = None
    """Motion (.npz): FLAME parameters, or weights of a rig's blend shapes; by default the model folder's own."""

    level: Literal[1, 2, 3, 4, "archive"] = 2
    """1 is the smallest, 4 the best; `archive` keeps every bit of every number."""

    target_size: Annotated[MaybeText, tyro.conf.arg(metavar="SIZE", help_behavior_hint="(instead of --level)")] = None
    """The best file of at most this size, motion and all: 300KB, 0.3MB."""

    target_psnr: Annotated[MaybeFloat, tyro.conf.arg(metavar="DB", help_behavior_hint="(instead of --level)")] = None
    """The smallest file whose pictures are so near those of the uncompressed avatar in its own motion, decibels."""

    no_rendering: bool = False
    """Go by rules alone, without looking at pictures to tell what is worth its bits: quicker, and a larger file."""

    weights: Annotated[MaybeWeights, tyro.conf.arg(metavar="REGION=FACTOR...", help_behavior_hint="")] = None
    """How many times as much an error counts in a region: mouth=4 eyes=4. Its bytes come from the others. `learned` weighs regions as
    training found them sensitive (one over their modulators), `learned=4` more so: of avatars that have it."""

    scheme: FileOption = None
    """With --weights: regions of one's own (.scheme.npz) instead of the avatar's."""

    tune: bool = False
    """Leave out Gaussians that others can make up for, and fit these to the avatar's own pictures, also to make up for rounding, for some
    minutes: half the bytes at 35 dB, a third fewer at 40 dB, an eighth fewer at 45 dB, or more quality at the same size."""

    dataset: Annotated[MaybePath, tyro.conf.arg(metavar="DATASET", help_behavior_hint="")] = None
    """The same, and in the end fitted to the training images of the capture that it was trained on."""

    measure: bool = False
    """Measure how near the file's pictures are to those of the uncompressed avatar, decibels."""

    profile: Literal["sacha", "paper"] = "sacha"
    """`paper` codes as the SACHA paper does, at the rate points 1 to 4 of MPEG's JEE6.2, to compare with."""

    tmc3: FileOption = None
    """With the paper's profile: an external `tmc3` or GeS-TM program for points and attributes, instead of this project's own coder."""

    embed_head: bool = False
    """Put the head into the file too, so that it opens anywhere; its bytes are counted apart."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Compress what was named.

    Raises:
        SachaError: avatar, head or motion is broken, or they do not belong together.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.encoding import make, require_consistent, sightless
    from sacha_core.cli.inspect import byte_counts
    from sacha_core.cli.sources import open_avatar
    from sacha_core.codec import inspect
    from sacha_core.files import write_aside

    if (options.model is None) == (options.ply is None):
        raise OptionError("expected one of the two: a model folder, or --ply FILE with --head HEAD")
    path = options.model or options.ply
    assert path is not None
    if options.ply is not None and options.ply.suffix.lower() != ".ply":
        raise OptionError(f"--ply {options.ply}: expected a file whose name ends in .ply")
    require_consistent(options)
    opened = open_avatar(path, options.head, options.motion)
    avatar = opened.avatar
    made = make(options, avatar, opened.head, console)
    data = made.data
    with write_aside(options.output) as aside:
        aside.write_bytes(data)
    found = inspect(data)
    raw = ply_bytes(avatar.gaussians)
    tell(options, found, len(avatar.gaussians), raw, console)
    if options.no_rendering and sightless(options) is not None:
        console.say(f"note         --no-rendering changes nothing: {sightless(options)} never looks at pictures")
    if made.psnr_db is not None:
        console.say(f"pictures     {made.psnr_db:.2f} dB from those of the uncompressed avatar")
    if made.is_best:
        console.say(
            f"note         {options.target_size} is more than this avatar takes: the file is of the best quality there is, and more bytes"
            " would bring nothing (--level archive keeps every bit)"
        )
    console.hint(f"sacha render {options.output} --frame 0 -o {options.output.with_suffix('.png')}")
    return {
        "file": options.output,
        "level": options.level if options.level == "archive" else found.level,
        "psnr_db": made.psnr_db,
        "n_trials": made.n_trials,
        "n_gaussians": found.n_gaussians,
        "n_gaussians_left_out": len(avatar.gaussians) - found.n_gaussians,
        "n_frames": found.n_frames,
        "raw_bytes": raw,
        "bytes": byte_counts(found),
        "sections": {section.name: section.n_bytes for section in found.sections},
        "head": asdict(avatar.head),
    }


def ply_bytes(gaussians: Gaussians) -> int:
    """Give the bytes that the numbers of Gaussians take in GaussianAvatars' PLY, float32 each."""
    return 4 * (15 + 3 * (gaussians.sh_degree + 1) ** 2) * len(gaussians)


def tell(options: Options, found: Inspection, n_given: int, raw_bytes: int, console: Console) -> None:
    """Say what was written, and what each part costs."""
    left_out = n_given - found.n_gaussians
    are, their, were = ("is", "its", "was") if left_out == 1 else ("are", "their", "were")
    console.wrote("avatar", options.output, f"{grade(found)}, {kilobytes(found.total_bytes)}")
    console.say(
        f"gaussians    {kilobytes(found.gaussian_bytes)} for {found.n_gaussians:,}"
        + (f" ({left_out:,} that {are} not worth {their} bits {were} left out)" if left_out else "")
        + f"; as PLY {kilobytes(raw_bytes)}, {times_as_much(raw_bytes / found.gaussian_bytes)}"
    )
    if found.n_frames:
        console.say(
            f"motion       {kilobytes(found.motion_bytes)} for {counted(found.n_frames, 'frame')}, "
            f"{found.dynamic_bytes_per_frame:.1f} bytes each"
        )
    else:
        console.say("motion       none; --motion FILE puts one in")
    console.say(
        f"head         {kilobytes(found.head_bytes)}, inside the file"
        if found.head_bytes
        else f"head         not inside: whoever opens the file needs {found.head.name!r} (--embed-head puts it in)"
    )


def times_as_much(factor: float) -> str:
    """Say how many times as much something is, with a decimal where whole numbers would say nothing."""
    times = f"{factor:.{0 if factor >= 1.95 else 1}f}"
    return "as much" if times == "1.0" else f"{times} times as much"
