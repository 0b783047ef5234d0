"""`sacha ablate`: which variant spends its Gaussians best?"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common, HeadSource, MaybeInt, MaybeText
from sacha_core.cli.console import Console
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.evaluate.ablation.plan import Judging, PlannedRun
    from sacha_core.evaluate.executors.jobs import Executor

__all__ = ["OUTPUT_FOLDERS", "Options", "run"]

OUTPUT_FOLDERS = ("output",)

VARIANTS = ("default", "rad", "rad-gp-lgs", "rad-gp-pis", "default-gp-pis", "paper", "sacha")
QUICK_VARIANTS = ("default", "rad-gp-pis", "sacha")
ITERATIONS, QUICK_ITERATIONS = 6000, 3000
SEEDS, QUICK_SEEDS = 3, 3
IMAGES, QUICK_IMAGES = 100, 60
FLIP_IMAGES, QUICK_FLIP_IMAGES = 30, 15


@dataclass(frozen=True)
class Sweep:
    """What is compared."""

    variants: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME...", help_behavior_hint=f"(default: {' '.join(VARIANTS)})")
    ] = ()
    """Variants of `sacha train`; NEW=VARIANT puts one under another name, of which --set changes options."""

    set_: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="[VARIANT:]OPTION=VALUE...", help_behavior_hint="")
    ] = ()
    """Change options of training (`sacha train --list-options` tells all), of every variant or one: sh_degree=1,
    sacha:pruning.ratio=0.25."""

    iterations: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {ITERATIONS})")] = None
    """Length of each training."""

    seeds: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {SEEDS})")] = None
    """How many seeds, from 0 on: variants are compared within a seed, and seeds tell how sure the differences are."""

    levels: Annotated[str, tyro.conf.arg(metavar="LEVELS")] = "1-4"
    """Levels of the codec: 1-4, or 1,3."""

    judge_images: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {IMAGES})")] = None
    """At most so many images of the held-out camera, and as many held-out expressions."""

    flip_images: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {FLIP_IMAGES})")] = None
    """At most so many of these, evenly spread, are also judged by FLIP and LPIPS, which take ten times as long as all else."""

    metrics: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME...", help_behavior_hint="(default: what is installed)")
    ] = ()
    """Flip, lpips, or both; psnr and ssim always come along."""

    quick: bool = False
    """A smaller comparison, which ends within 25 minutes on two cores: three variants, three seeds, 3000 iterations, 60 images."""


@dataclass(frozen=True)
class Where:
    """Where the work is done."""

    jobs: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="(default: one on each core)")] = None
    """How many processes work at once on this machine."""

    threads: Annotated[
        MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="(default: cores over jobs; on Ray 1)")
    ] = None
    """How many threads each uses."""

    ray: Annotated[MaybeText, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """Work on the Ray cluster at this address (or "auto"), whose nodes share these files, instead of in processes of this machine."""


@dataclass(frozen=True)
class Options:
    """Train, compress and judge variants beside one another, and write a report.

    Variants of one capture and seed begin with the same warm-up. Every run lies in OUT/DATASET/seed-S/VARIANT, its figures in result.json.
    The same command again goes on where it was interrupted; runs that are done are kept.

    sacha ablate out/data -o out/ablation --quick
    """

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="OUT")]
    """Folder that everything goes to."""

    datasets: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DATASET...")] = ()
    """Captures; results call each by its folder's name."""

    restart: bool = False
    """Do runs anew that the folder holds with other options; they are refused otherwise."""

    report_only: bool = False
    """Train nothing: make the report again, of all results in the folder."""

    sweep: Sweep = field(default_factory=Sweep)
    where: Where = field(default_factory=Where)
    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Do what is missing, then write the report.

    Raises:
        SachaError: a capture, an option or a result makes no sense, or the runs that are there are others.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.ablate_report import make_report, note_conditions, tell
    from sacha_core.cli.program import require_there
    from sacha_core.evaluate.ablation.ablate import Ablated, ablate
    from sacha_core.evaluate.ablation.ledger import read_results

    if options.report_only:
        results = read_results(options.output)
        if not results:
            raise OptionError(f"{options.output} holds no results to report on")
        done = Ablated(results, len(results), ())
    else:
        require_there(options.datasets)
        executor = executor_of(options.where)
        runs = plan(options)
        counts = (
            len({run.dataset for run in runs}),
            len({run.variant for run in runs}),
            len({run.options.seed for run in runs}),
        )
        console.say(
            f"ablation     {len(runs)} runs of {runs[0].options.schedule.iterations:,} iterations: "
            f"datasets {counts[0]}, variants {counts[1]}, seeds {counts[2]}"
        )
        note_conditions(options.output, runs, sys.argv)
        done = ablate(runs, executor, console.report, options.restart)
    report = make_report(options.output, done.results, console) if done.results else None
    return tell(options.output, done, report, console)


def plan(options: Options) -> tuple[PlannedRun, ...]:
    """Give all runs, and keep the head of each capture beside them."""
    from sacha_core.cli.sources import capture_head
    from sacha_core.evaluate.ablation.datasets import keep_dataset
    from sacha_core.evaluate.ablation.plan import planned_runs
    from sacha_core.evaluate.ablation.variants import variant_options
    from sacha_core.interchange.capture import read_capture

    sweep, quick = options.sweep, options.sweep.quick
    iterations = given(sweep.iterations, QUICK_ITERATIONS if quick else ITERATIONS)
    seeds = given(sweep.seeds, QUICK_SEEDS if quick else SEEDS)
    variants = variant_options(sweep.variants or (QUICK_VARIANTS if quick else VARIANTS), iterations, sweep.set_)
    judging = judging_of(sweep)
    out, datasets = options.output.resolve(), []
    for root in options.datasets:
        capture = read_capture(root)
        datasets.append(keep_dataset(out, root, capture, capture_head(capture, options.head)))
    return planned_runs(out, datasets, variants, seeds, judging)


def judging_of(sweep: Sweep) -> Judging:
    """Give how runs are judged; FLIP, where nobody asks for it by name, only where its package is installed."""
    from sacha_core.evaluate.ablation.plan import Judging
    from sacha_core.evaluate.picture_metrics import METRICS, require_metrics
    from sacha_core.perception.flip import missing

    metrics = sweep.metrics or tuple(name for name in METRICS if name != "flip" or missing() is None)
    require_metrics(metrics)
    images = given(sweep.judge_images, QUICK_IMAGES if sweep.quick else IMAGES)
    perceptual = given(sweep.flip_images, QUICK_FLIP_IMAGES if sweep.quick else FLIP_IMAGES)
    return Judging(levels_of(sweep.levels), images, metrics, perceptual)


def levels_of(text: str) -> tuple[int, ...]:
    """Read levels: 2, or 1-4, or 1,3."""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.strip().isdecimal() or (dash and not last.strip().isdecimal()):
            raise OptionError(f"--levels is {text!r}, expected such as 1-4 or 1,3")
        found.extend(range(int(first), int(last or first) + 1))
    return tuple(found)


def given(value: int | None, usual: int) -> int:
    """Give what was asked for, or else what is usual."""
    return usual if value is None else value


def executor_of(where: Where) -> Executor:
    """Give what does the work."""
    from sacha_core.evaluate.executors.local import LocalProcesses
    from sacha_core.evaluate.executors.ray_cluster import RayCluster

    if where.ray is None:
        return LocalProcesses(where.jobs, where.threads)
    if where.jobs is not None:
        raise OptionError("--jobs is for this machine; a Ray cluster decides by itself how many run at once")
    return RayCluster(where.ray, where.threads)
