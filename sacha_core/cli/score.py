"""`sacha score`: what is each Gaussian of an avatar worth?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import (
    Common,
    FileOption,
    HeadSource,
    ImageSize,
    MaybePath,
    require_both_sides,
    require_size,
)
from sacha_core.cli.console import Console, table
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.evaluate.importance import Scored
    from sacha_core.train.options import TrainOptions

__all__ = ["INPUTS", "Options", "beside", "run"]

INPUTS = ("avatar", "motion", "dataset", "scheme")


@dataclass(frozen=True)
class Options:
    """Measure what each Gaussian of an avatar is worth, region by region.

    Writes the scores file from which `sacha prune` makes smaller avatars without training. The views are those of a capture's training
    cameras, or the avatar's own pictures, 550x802, from a rig of sixteen cameras round its head:

    sacha score a.ply --head rig.npz --masks FLAME_masks.npz --motion motion.npz

    sacha score MODEL --dataset DATASET -o MODEL.scores.npz
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """A .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[
        MaybePath,
        tyro.conf.arg(aliases=["-o"], metavar="FILE.npz", help_behavior_hint="(default: AVATAR.scores.npz, beside it)"),
    ] = None
    """Where the scores go."""

    motion: FileOption = None
    """Motion (.npz) to look at instead of the avatar's own; without any, the head keeps still."""

    dataset: Annotated[MaybePath, tyro.conf.arg(metavar="DATASET", help_behavior_hint="")] = None
    """A capture whose training cameras and images to use instead of the rig and the avatar's own pictures."""

    views: Annotated[int, tyro.conf.arg(metavar="N")] = 120
    """About how many views: all cameras at evenly spaced frames."""

    score: Literal["pis", "lgs", "removal", "removal-absolute"] = "pis"
    """pis: blending weight, more where the eye would notice (the paper's); lgs: LightGaussian's; removal: what the picture would change by
    without the Gaussian, squared or absolute."""

    means: Literal["visible", "plain", "weighted"] = "visible"
    """Which mean sensitivity tells what a region needs: of the Gaussians that show, of all, or weighted by how much of each shows."""

    scheme: FileOption = None
    """Regions of one's own (.scheme.npz) instead of those that masks make."""

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where to compute."""

    size: ImageSize = field(default_factory=ImageSize)
    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Score the avatar.

    Raises:
        SachaError: avatar, head, motion or capture is broken, or they do not belong together.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import open_avatar
    from sacha_core.density.scores_file import write_scores
    from sacha_core.evaluate.importance import score_avatar
    from sacha_core.files import require_writable
    from sacha_core.interchange.capture import read_capture
    from sacha_core.regions.scheme import find_scheme
    from sacha_core.regions.scheme_file import read_scheme_file

    chosen = score_options(options)
    output = options.output or beside(options.avatar)
    if output.suffix.lower() != ".npz":
        raise OptionError(f"{output}: expected the name of a scores file, such as {output.stem}.scores.npz")
    require_writable(output)
    capture = None if options.dataset is None else read_capture(options.dataset)
    opened = open_avatar(options.avatar, options.head, options.motion)
    gaussians, motion = opened.avatar.gaussians, opened.avatar.motion
    partition = None if options.scheme is None else read_scheme_file(options.scheme, opened.head)
    scored = score_avatar(gaussians, opened.head, motion, capture, chosen, console.report, partition)
    names = find_scheme(scored.scores.scheme).regions if partition is None else partition.regions
    write_scores(output, scored.scores)
    of = f"the training cameras of {capture.root}" if capture else "the rig round the head"
    console.wrote("scores", output, f"{len(gaussians):,} Gaussians in {scored.n_views} views of {of}")
    console.say(f"sensitivity  {where_from(scored)}")
    console.say(f"\n{region_table(scored, names)}")
    head = "".join(f" --{name} {value}" for name, value in asdict(options.head).items() if value is not None)
    console.hint(f"sacha prune {options.avatar}{head} --scores {output} --keep 0.6 -o {smaller(options.avatar)}")
    return report(scored, names, options, output)


def score_options(options: Options) -> TrainOptions:
    """Give the options of the measurement.

    Raises:
        OptionError: a number is out of range.
    """
    from sacha_core.train.options import TrainOptions

    if options.views < 1:
        raise OptionError(f"--views is {options.views}, expected at least 1")
    size = options.size
    require_size(width=size.width, height=size.height)
    require_both_sides(size.width, size.height)
    usual = TrainOptions(width=size.width, height=size.height, device=options.device)
    importance, density = replace(usual.importance, views=options.views), replace(usual.density, means=options.means)
    pruning = replace(usual.pruning, score=options.score)
    return replace(usual, importance=importance, density=density, pruning=pruning)


def beside(avatar: Path) -> Path:
    """Give the place of an avatar's scores; those that training leaves in a model folder are others, of earlier, and stay."""
    whole = avatar.resolve()
    return avatar.parent / f"{whole.name if avatar.is_dir() else whole.stem}.scores.npz"


def smaller(avatar: Path) -> Path:
    """Give a name for the avatar after pruning."""
    if avatar.is_dir():
        return avatar.with_name(f"{avatar.resolve().name}_smaller")
    return avatar.with_name(f"{avatar.stem}_smaller{'.ply' if avatar.suffix.lower() == '.ply' else ''}")


def where_from(scored: Scored) -> str:
    """Say where the sensitivities come from."""
    if scored.learned:
        return "as learned in training"
    hidden = int((~scored.visible).sum())
    return (
        "none was learned: each Gaussian has the mean sensitivity of the pixels that it shows in"
        + f", and the {hidden:,} that show nowhere the initial 0.1" * bool(hidden)
    )


def region_table(scored: Scored, names: Sequence[str]) -> str:
    """Set the regions as measured as a table."""
    rows = [
        (
            row["region"],
            f"{row['count']:,}",
            f"{row['visible']:,}",
            "-" if row["mean"] is None else f"{row['mean']:.3f}",
            f"{row['modulator']:.3f}",
            f"{row['threshold']:.2e}",
            f"{row['ratio']:.3f}",
        )
        for row in regions(scored, names)
    ]
    return table(("region", "Gaussians", "visible", f"a_R ({scored.calibration.used})", "m_R", "tau_R", "rho_R"), rows)


def regions(scored: Scored, names: Sequence[str]) -> list[dict[str, Any]]:
    """Give what was measured of each region."""
    found = scored.calibration
    means = {"plain": found.mean_plain, "visible": found.mean_visible, "weighted": found.mean_weighted}
    return [
        {
            "region": name,
            "count": found.counts[r],
            "visible": found.visible_counts[r],
            "mean": means[found.used][r],
            **{f"mean_{kind}": of[r] for kind, of in means.items()},
            "modulator": found.modulator[r],
            "threshold": found.threshold[r],
            "ratio": found.ratio[r],
        }
        for r, name in enumerate(names)
    ]


def report(scored: Scored, names: Sequence[str], options: Options, output: Path) -> dict[str, Any]:
    """Give the report for machines."""
    return {
        "avatar": options.avatar,
        "scores": output,
        "n_gaussians": len(scored.visible),
        "n_visible": int(scored.visible.sum()),
        "n_views": scored.n_views,
        "views_from": "capture" if options.dataset else "rig",
        "sensitivity": "learned" if scored.learned else "estimated",
        "score": options.score,
        "means": options.means,
        "regions": regions(scored, names),
    }
