"""`sacha demo`: the whole of SACHA on a head made of nothing but code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sacha_core.cli.common import Common
from sacha_core.cli.console import Console, table, write_report
from sacha_core.cli.waiting import duration
from sacha_core.stopwatch import Stopwatch

if TYPE_CHECKING:
    from sacha_core.avatar.avatar import Avatar
    from sacha_core.evaluate.comparison import Quality, VariantResult
    from sacha_core.flame.model import HeadModel
    from sacha_core.interchange.capture import Capture
    from sacha_core.train.options import TrainOptions

__all__ = ["OUTPUT_FOLDERS", "Options", "run"]

OUTPUT_FOLDERS = ("out",)

BASELINE, OURS = "default", "sacha"
ITERATIONS = 4800


@dataclass(frozen=True)
class Options:
    """Film a synthetic head, train an avatar of it twice, compress, decode and judge.

    The two trainings share their warm-up: one is the paper's baseline without regions, the other SACHA. Ends with a table, a picture and
    the paths of what was written. The same command again continues where it was interrupted.
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")] = Path("out/demo")
    """Where everything goes."""

    iterations: Annotated[int, tyro.conf.arg(metavar="N")] = ITERATIONS
    """Length of each training."""

    timesteps: Annotated[int, tyro.conf.arg(metavar="N")] = 13
    """How many each of the four sequences to train on has."""

    width: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 275
    """Image width."""

    height: Annotated[int, tyro.conf.arg(metavar="PIXELS")] = 401
    """Image height."""

    head: Annotated[str, tyro.conf.arg(metavar="HEAD")] = "synthetic"
    """Who performs: "synthetic" or "synthetic:small"."""

    seed: int = 0
    """Of everything random."""

    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Run every stage.

    Raises:
        SachaError: an option makes no sense.
        OSError: a file cannot be written.
    """
    from sacha_core.evaluate.comparison import Judge
    from sacha_core.evaluate.overview import Overview

    plans = {
        name: training(options, name) for name in (BASELINE, OURS)
    }  # first of all: what makes no sense is said at once
    watch = Stopwatch()
    with watch("synth"):
        capture, head = film(options, console)
    avatars = train_all(plans, options.out, console, capture, head, watch)
    judge = Judge(capture, head, console.report)
    results = {}
    for name, avatar in avatars.items():
        with watch(f"judge {name}"):
            results[name] = judge.variant(name, avatar, options.out)
    with watch("picture"):
        Overview(capture, head, BASELINE, OURS, avatars, results).write(options.out / "overview.png")
    seconds = watch.seconds | {"total": sum(watch.seconds.values())}
    report = {
        "variants": {name: result.to_json() for name, result in results.items()},
        "seconds": {stage: round(value, 2) for stage, value in seconds.items()},
    }
    write_report(options.out / "report.json", report)
    tell(options, console, results, watch)
    return report


def film(options: Options, console: Console) -> tuple[Capture, HeadModel]:
    """Make the capture, or keep the one that is there."""
    from sacha_core.cli.filming import make_capture
    from sacha_core.cli.sources import keep
    from sacha_core.flame.open import open_head
    from sacha_core.interchange.capture import read_capture
    from sacha_core.synthesis.options import SynthOptions

    chosen = SynthOptions(
        width=options.width, height=options.height, seed=options.seed, train_timesteps=options.timesteps
    )
    head = open_head(options.head)
    keep(head)
    make_capture(options.out / "capture", head, chosen, console)
    return read_capture(options.out / "capture"), head


def training(options: Options, name: str) -> TrainOptions:
    """Give the options of one variant's run."""
    from sacha_core.train.options import TrainOptions
    from sacha_core.train.presets import scaled

    return scaled(options.iterations, name, TrainOptions(seed=options.seed))


def train_all(
    plans: Mapping[str, TrainOptions],
    out: Path,
    console: Console,
    capture: Capture,
    head: HeadModel,
    watch: Stopwatch,
) -> dict[str, Avatar]:
    """Train each variant in turn, all but the first from its warm-up on."""
    from sacha_core.avatar.avatar import Avatar
    from sacha_core.train.loop import train
    from sacha_core.train.output import WARM_UP_CHECKPOINT

    avatars = {}
    start_from = None
    for name, plan in plans.items():
        with watch(f"train {name}"):
            trained = train(capture, head, plan, out / name, console.report, start_from=start_from)
        start_from = start_from or out / name / WARM_UP_CHECKPOINT
        avatars[name] = Avatar(trained.gaussians, head.reference, trained.motion)
    return avatars


def tell(options: Options, console: Console, results: Mapping[str, VariantResult], watch: Stopwatch) -> None:
    """Say what came out, as tables and paths."""
    rows = []
    for name, result in results.items():
        cells = (f"{result.n_gaussians:,}", f"{result.raw_bytes / 1000:,.1f} KB", "")
        rows.append((f"{name}, uncompressed", *cells, *figures(result.novel_view, result.novel_expression)))
        for level, coded in sorted(result.levels.items(), reverse=True):
            cells = ("", f"{coded.n_bytes / 1000:,.1f} KB", f"{coded.bytes_per_frame:.0f} B")
            rows.append((f"  level {level}", *cells, *figures(coded.novel_view, coded.novel_expression)))
    titles = ("", "Gaussians", "size", "motion a frame", "view PSNR", "SSIM", "expression PSNR", "SSIM")
    console.say(table(titles, rows))
    theirs, ours = results[BASELINE], results[OURS]
    console.say()
    shares = []
    for region in theirs.per_region:
        both = [(result.per_region[region], result.visible_per_region[region]) for result in (theirs, ours)]
        shares.append((region, *(f"{count:,}" for pair in both for count in pair)))
    console.say(table(("region", BASELINE, "that show", OURS, "that show"), shares))
    console.say(
        f"\n{OURS} uses {ours.n_gaussians / theirs.n_gaussians:.0%} of the Gaussians of {BASELINE} "
        f"({ours.n_visible / max(theirs.n_visible, 1):.0%} of those that show) at "
        f"{ours.novel_view.psnr - theirs.novel_view.psnr:+.2f} dB by the held-out camera and "
        f"{ours.novel_expression.psnr - theirs.novel_expression.psnr:+.2f} dB in held-out expressions.\n"
    )
    console.say("took         " + ", ".join(f"{stage} {duration(s)}" for stage, s in watch.seconds.items()))
    console.wrote("picture", options.out / "overview.png")
    console.wrote("report", options.out / "report.json")
    console.wrote("avatar", ours.levels[2].file)
    console.hint(f"sacha render {ours.levels[2].file} --video {options.out / 'avatar.mp4'}")


def figures(*qualities: Quality) -> tuple[str, ...]:
    """Give PSNR and SSIM of each as text."""
    return tuple(text for quality in qualities for text in (f"{quality.psnr:.2f} dB", f"{quality.ssim:.4f}"))
