"""`sacha framewise`: what does a capture cost where each frame is fitted by itself?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, HeadSource, ImageSize, MaybeInt, require_both_sides, require_size
from sacha_core.cli.console import Console, table, write_report
from sacha_core.cli.waiting import duration
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.train.framewise import FrameResult
    from sacha_core.train.options import TrainOptions

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run"]

INPUTS = ("dataset",)
OUTPUT_FOLDERS = ("output",)
REPORT = "report.json"
MEANS = ("n", "bytes", "psnr", "ssim", "training_seconds")


@dataclass(frozen=True)
class Options:
    """Fit a static 3D Gaussian Splatting to each of some consecutive frames: the baseline without an avatar.

    Each frame is fitted from its own training images alone, beginning with points on the tracked mesh, and written as a PLY that splat
    viewers open; the held-out camera judges it. The same command again goes on after the last frame that was finished.

    sacha framewise out/data --frames 10 -o out/framewise
    """

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """A capture, as `sacha synth` or VHAP's export for GaussianAvatars writes it."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="OUT")]
    """Folder that the frames and their report go to."""

    frames: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """How many timesteps."""

    first: Annotated[int, tyro.conf.arg(metavar="TIMESTEP")] = 0
    """Which timestep is the first."""

    iterations: Annotated[int, tyro.conf.arg(metavar="N")] = 2000
    """Of each frame's fit."""

    seed: int = 0
    """Of everything random."""

    sh_degree: Literal[0, 1, 2, 3] = 3
    """Highest degree of the spherical harmonics."""

    threads: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="(default: one for each core)")] = None
    """How many threads work."""

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where to compute."""

    size: ImageSize = field(default_factory=ImageSize)
    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Fit the frames.

    Raises:
        SachaError: the capture or an option makes no sense, or the head is not to be found.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import capture_head
    from sacha_core.interchange.capture import read_capture
    from sacha_core.train.framewise import fit_frames

    base = train_options(options)
    capture = read_capture(options.dataset)
    head = capture_head(capture, options.head)
    timesteps = range(options.first, options.first + options.frames)
    results = fit_frames(capture, head, timesteps, options.iterations, options.output, base, console.report)
    found = report(options, capture.root, results)
    write_report(options.output / REPORT, found)
    console.wrote("frames", options.output, f"{len(results)} of {options.iterations:,} iterations each")
    console.say(f"pictures     {options.output}/frame_*/held_out.png: the capture at the left, the fit at the right")
    console.say(f"\n{frame_table(results)}")
    return found


def train_options(options: Options) -> TrainOptions:
    """Give the options that all frames share.

    Raises:
        OptionError: a number is out of range.
    """
    from sacha_core.train.options import TrainOptions

    for name, least in (("frames", 1), ("first", 0), ("iterations", 20)):
        if getattr(options, name) < least:
            raise OptionError(f"--{name} is {getattr(options, name)}, expected at least {least}")
    size = options.size
    require_size(width=size.width, height=size.height)
    require_both_sides(size.width, size.height)
    return TrainOptions(
        seed=options.seed, sh_degree=options.sh_degree, width=size.width, height=size.height, device=options.device,
        threads=options.threads,
    )  # fmt: skip


def frame_table(results: Sequence[FrameResult]) -> str:
    """Set the frames as a table, with their sums and means."""

    def row(name: str, of: Mapping[str, float]) -> tuple[str, ...]:
        size, seconds = f"{of['bytes'] / 1e6:.2f}", duration(of["training_seconds"])
        return (name, f"{of['n']:,.0f}", size, f"{of['psnr']:.2f} dB", f"{of['ssim']:.4f}", seconds)

    rows = [*(row(str(r.timestep), asdict(r)) for r in results), row("mean", means(results))]
    return table(("timestep", "Gaussians", "MB", "PSNR", "SSIM", "time"), rows)


def means(results: Sequence[FrameResult]) -> dict[str, float]:
    """Give the means over the frames."""
    return {name: sum(getattr(r, name) for r in results) / len(results) for name in MEANS}


def report(options: Options, root: Path, results: Sequence[FrameResult]) -> dict[str, Any]:
    """Give the report for machines; `bytes` are of the Gaussians uncompressed, 248 each."""
    from sacha_core.train.framewise import frame_ply

    return {
        "dataset": root,
        "iterations": options.iterations,
        "mean": means(results),
        "bytes": sum(r.bytes for r in results),
        "training_seconds": sum(r.training_seconds for r in results),
        "frames": [
            {**asdict(r), "file": frame_ply(options.output, r.timestep).relative_to(options.output)} for r in results
        ],
    }
