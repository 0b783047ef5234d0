"""`sacha train`: from a capture to an avatar."""

from __future__ import annotations

import textwrap
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import tyro

from sacha_core.cli.common import Common, HeadSource, MaybeInt, PixelsOption, require_both_sides
from sacha_core.cli.console import Console, kilobytes, table
from sacha_core.cli.waiting import duration
from sacha_core.errors import OptionError
from sacha_core.stopwatch import Stopwatch

if TYPE_CHECKING:
    from sacha_core.flame.model import HeadModel
    from sacha_core.interchange.capture import Capture
    from sacha_core.train.options import TrainOptions
    from sacha_core.train.output import TrainedModel

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run"]

INPUTS = ("dataset",)
OUTPUT_FOLDERS = ("output",)
LISTS = {"--list-options": "list_options"}  # flags by which the command prints something and does nothing

Variant = Literal[
    "ga", "default", "default-seen", "rad", "rad-gp-lgs", "rad-gp-pis", "default-gp-pis", "paper", "mask", "sacha",
    "paper-inverted", "paper-random", "sacha-inverted", "sacha-random", "sacha-uniform",
]  # fmt: skip
MaybeLevel = Optional[Literal[1, 2, 3, 4]]  # noqa: UP045 (see cli/common.py)
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

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where to compute: auto takes a CUDA device where there is one that gsplat can use, and the CPU elsewhere. A run that goes on
    stays where it was, unless told otherwise."""

    cameras_per_step: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    """How many views of one timestep a step learns from at once, at most."""

    set_: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="OPTION=VALUE...", help_behavior_hint="")] = ()
    """Change any option by its name: pruning.ratio=0.3 density.means=visible. `sacha train --list-options` tells all."""

    finetune_level: Annotated[MaybeLevel, tyro.conf.arg(metavar="1|2|3|4", help_behavior_hint="")] = None
    """After training, leave out what other Gaussians make up for, fit these to the capture while they are rounded, and write
    level-N.sacha into the folder: as near to the capture as what `sacha encode MODEL --level N` gives, in fewer bytes."""

    timings: bool = False
    """Tell at the end where an iteration's time went."""

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
    from sacha_core.cli.stopping import stopping_gently
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
    watch = Stopwatch() if options.timings else None
    start = time.perf_counter()
    resume = not options.restart
    with stopping_gently() as stop:
        trained = train(capture, head, chosen, options.output, console.report, resume, stopwatch=watch, stop=stop)
    seconds = time.perf_counter() - start
    counts = region_counts(label_triangles(head, PAPER), trained.gaussians.binding)
    by_region = {name: int(count) for name, count in zip(PAPER.regions, counts, strict=True)}
    console.wrote("model", trained.folder, f"{trained.iteration:,} iterations in {duration(seconds)}")
    console.say(
        f"gaussians    {len(trained.gaussians):,}: "
        + ", ".join(f"{name} {count:,}" for name, count in by_region.items())
    )
    if trained.faults.count:
        console.say(f"faults       {trained.faults}")
    stages = [] if watch is None else stage_times(watch)
    if stages:
        rows = [(row["stage"], f"{row['ms_per_iteration']:.3f}", f"{row['share']:.1%}") for row in stages]
        console.say(f"\n{table(('stage', 'ms an iteration', 'share'), rows)}")
    tuned = None if options.finetune_level is None else write_tuned(options, trained, capture, head, console)
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
        "faults": asdict(trained.faults),
        "device": trained.device,
        "training_seconds": seconds,
        "tuned": tuned,
        "timings": stages,
    }


def write_tuned(
    options: Options, trained: TrainedModel, capture: Capture, head: HeadModel, console: Console
) -> dict[str, Any]:
    """Fit the model to what it was trained on while its file is made, write that, and tell of both."""
    from sacha_core.avatar.avatar import Avatar
    from sacha_core.files import write_aside
    from sacha_core.rate.making_up import MakingUpOptions
    from sacha_core.rate.pictures import CaptureSteps
    from sacha_core.rate.tuned import encode_tuned
    from sacha_core.train.views import TrainingViews

    level = options.finetune_level
    assert level is not None
    path = trained.folder / f"level-{level}.sacha"
    avatar = Avatar(trained.gaussians, head.reference, trained.motion)
    steps = CaptureSteps(TrainingViews(capture, options.width, options.height))
    how = MakingUpOptions(loss="training", threads=options.threads, seed=options.seed)
    start = time.perf_counter()
    data = encode_tuned(avatar, level, head=head, steps=steps, options=how, report=console.report)
    seconds = time.perf_counter() - start
    with write_aside(path) as aside:
        aside.write_bytes(data)
    console.wrote("avatar", path, f"level {level}, {kilobytes(len(data))}, fitted to it in {duration(seconds)}")
    return {"file": path, "level": level, "bytes": len(data), "seconds": seconds}


def stage_times(watch: Stopwatch) -> list[dict[str, Any]]:
    """Give where an iteration went, stage by stage, with the whole last; nothing where no iteration was measured."""
    from sacha_core.train.loop import REST

    count, whole = watch.counts.get(REST, 0), sum(watch.seconds.values())
    if not count:
        return []
    seconds = {stage: value for stage, value in watch.seconds.items() if stage != REST}
    seconds |= {REST: watch.seconds[REST], "all": whole}
    return [
        {"stage": stage, "ms_per_iteration": 1e3 * value / count, "share": value / whole}
        for stage, value in seconds.items()
    ]


def train_options(options: Options) -> TrainOptions:
    """Give the options of the run that was asked for.

    Raises:
        OptionError: --iterations and --preset contradict each other, a setting makes no sense, or a number is out of range.
    """
    from sacha_core.train.options import TrainOptions
    from sacha_core.train.presets import scaled, variant
    from sacha_core.train.settings import with_settings

    require_both_sides(options.width, options.height)
    if options.preset is not None and options.iterations is not None:
        raise OptionError("--preset paper is a run of 360,000 iterations; expected it or --iterations, not both")
    base = TrainOptions(
        seed=options.seed,
        sh_degree=options.sh_degree,
        width=options.width,
        height=options.height,
        device=options.device,
        cameras_per_step=options.cameras_per_step,
        threads=options.threads,
    )
    if options.preset is not None:
        chosen = variant(base, options.variant)
    else:
        chosen = scaled(ITERATIONS if options.iterations is None else options.iterations, options.variant, base)
    return with_settings(chosen, options.set_)


def list_options() -> str:
    """Give every option with its default and what it is, one after the other."""
    from sacha_core.train.settings import known_settings

    entries = []
    for setting in known_settings().values():
        default = written(setting.default)
        about = textwrap.fill(
            f"{setting.doc} ({setting.expected})", 110, initial_indent="    ", subsequent_indent="    "
        )
        entries.append(f"{setting.name}={default}\n{about}")
    return "\n".join(entries)


def written(value: object) -> str:
    """Write a value as --set takes it."""
    if isinstance(value, tuple):
        return ",".join(":".join(map(str, one)) if isinstance(one, tuple) else str(one) for one in value)
    return {True: "yes", False: "no", None: "none"}[value] if isinstance(value, bool | None) else str(value)
