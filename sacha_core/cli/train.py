"""`sacha train`: from a capture to an avatar."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import tyro

from sacha_core.cli.common import Common, HeadSource, MaybeInt, PixelsOption, require_both_sides
from sacha_core.cli.console import Console
from sacha_core.cli.waiting import duration
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.train.options import TrainOptions

__all__ = ["INPUTS", "Options", "run"]

INPUTS = ("dataset",)

Variant = Literal["ga", "default", "rad", "rad-gp-lgs", "rad-gp-pis", "default-gp-pis", "paper", "sacha"]
MaybePreset = Optional[Literal["paper"]]  # noqa: UP045 (see cli/common.py)
ITERATIONS = 6000  # some minutes on two cores


@dataclass(frozen=True)
class Options:
    """Train an avatar on a multi-view capture.

    Writes a model folder in the layout of GaussianAvatars: the Gaussians as PLY and the fitted motion under point_cloud/iteration_N; beside
    it options, events, scores and a checkpoint. The same command again continues a run that was interrupted.

    sacha train out/data -o out/model
    """

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """A capture, as `sacha synth` or VHAP's export for GaussianAvatars writes it."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="MODEL")]
    """Folder that the model goes to."""

    variant: Variant = "sacha"
    """How Gaussians are grown and pruned; all but `ga` and `default` give each region of the head its own share."""

    iterations: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {ITERATIONS})")] = None
    """Length of the run; every event of the paper's run comes at the same fraction of it."""

    preset: Annotated[MaybePreset, tyro.conf.arg(metavar="paper", help_behavior_hint="")] = None
    """Instead of --iterations: the paper's run of 360,000."""

    seed: int = 0
    """Of everything random: the same seed gives the same bytes, however many threads work."""

    sh_degree: Literal[0, 1, 2, 3] = 3
    """Highest degree of the spherical harmonics: how much colour may change with the direction of view."""

    width: PixelsOption = None
    """Width of the images that are trained on; by default the stored one."""

    height: PixelsOption = None
    """Height of these images; by default the stored one."""

    threads: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="(default: one for each core)")] = None
    """How many threads work."""

    restart: bool = False
    """Begin anew, even where the folder holds an interrupted run."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Train on the capture.

    Raises:
        SachaError: the capture or an option makes no sense, or the head is not to be found.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import capture_head
    from sacha_core.interchange.capture import read_capture
    from sacha_core.regions.labels import label_triangles, region_counts
    from sacha_core.regions.scheme import PAPER
    from sacha_core.train.loop import train

    chosen = train_options(options)
    capture = read_capture(options.dataset)
    head = capture_head(capture, options.head)
    console.say(
        f"training     {len(capture.train):,} images of {len({view.timestep for view in capture.train})} timesteps, head {head.name!r}, "
        f"{chosen.schedule.iterations:,} iterations, variant {chosen.variant!r}"
    )
    start = time.perf_counter()
    trained = train(capture, head, chosen, options.output, report=console.report, resume=not options.restart)
    seconds = time.perf_counter() - start
    counts = region_counts(label_triangles(head, PAPER), trained.gaussians.binding)
    by_region = {name: int(count) for name, count in zip(PAPER.regions, counts, strict=True)}
    console.wrote("model", trained.folder, f"{trained.iteration:,} iterations in {duration(seconds)}")
    console.say(
        f"gaussians    {len(trained.gaussians):,}: "
        + ", ".join(f"{name} {count:,}" for name, count in by_region.items())
    )
    console.hint(
        f"sacha evaluate {trained.folder} {options.dataset}",
        f"sacha encode {trained.folder} -o {trained.folder.with_suffix('.sacha')}",
    )
    return {
        "model": trained.folder,
        "iterations": trained.iteration,
        "variant": chosen.variant,
        "seed": chosen.seed,
        "n_gaussians": len(trained.gaussians),
        "per_region": by_region,
        "n_events": len(trained.events),
        "training_seconds": seconds,
    }


def train_options(options: Options) -> TrainOptions:
    """Give the options of the run that was asked for.

    Raises:
        OptionError: --iterations and --preset contradict each other, or a number is out of range.
    """
    from sacha_core.train.options import TrainOptions
    from sacha_core.train.presets import scaled, variant

    require_both_sides(options.width, options.height)
    if options.preset is not None and options.iterations is not None:
        raise OptionError("--preset paper is a run of 360,000 iterations; expected it or --iterations, not both")
    base = TrainOptions(
        seed=options.seed,
        sh_degree=options.sh_degree,
        width=options.width,
        height=options.height,
        threads=options.threads,
    )
    if options.preset is not None:
        return variant(base, options.variant)
    return scaled(ITERATIONS if options.iterations is None else options.iterations, options.variant, base)
