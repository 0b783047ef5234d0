"""`sacha prune`: a smaller avatar from an avatar and its scores, without training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeFloat, MaybeInt
from sacha_core.cli.console import Console, table
from sacha_core.cli.score import beside
from sacha_core.errors import OptionError, TopologyError

if TYPE_CHECKING:
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.cli.sources import Opened
    from sacha_core.density.rebudget import Budget, Rebudget
    from sacha_core.density.scores_file import Scores
    from sacha_core.regions.scheme import RegionScheme

__all__ = ["INPUTS", "Options", "run"]

INPUTS = ("avatar", "motion", "scores")

ITERATION = 1  # a folder of a model names its iterations; a PLY has had none that are known


@dataclass(frozen=True)
class Options:
    """Cut an avatar down to a budget by its scores, sparing the regions that matter.

    Takes the Gaussians from the scores file: of a trained model, those that it had before its last pruning, untrained since; `sacha score
    MODEL --dataset DATASET` scores the finished ones. One ranking decides over all Gaussians; what no view shows goes first.

    sacha prune a.ply --head rig.npz --masks FLAME_masks.npz --keep 0.6 --weights mouth=2 eyes=1.5 -o smaller.ply
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """What was scored: a .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="OUT")]
    """A PLY of bound Gaussians where the name ends in .ply, else a model folder in the layout of GaussianAvatars."""

    scores: Annotated[FileOption, tyro.conf.arg(help_behavior_hint="(default: AVATAR.scores.npz beside it)")] = None
    """What `sacha score` wrote; of a model folder that was never scored, what training left in it."""

    keep: Annotated[
        MaybeFloat, tyro.conf.arg(metavar="SHARE", help_behavior_hint="(this, --ratio or --target-count)")
    ] = None
    """How much stays: 0.6 keeps six Gaussians of ten."""

    ratio: Annotated[MaybeFloat, tyro.conf.arg(metavar="SHARE", help_behavior_hint="")] = None
    """How much goes: 0.4 is --keep 0.6."""

    target_count: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """How many Gaussians stay."""

    weights: Annotated[tuple[str, ...], tyro.conf.arg(metavar="REGION=FACTOR...", help_behavior_hint="")] = ()
    """How much more regions are worth than measured: mouth=2 counts each of the mouth's scores twice."""

    scope: Literal["weighted", "regions", "all"] = "weighted"
    """weighted: one ranking, by score over the region's modulator; regions: each region loses its own share, as in the paper, so that
    the total is near the budget only; all: one ranking by score alone."""

    bounds: Annotated[tuple[float, float], tyro.conf.arg(metavar="LOWEST HIGHEST")] = (0.5, 2.0)
    """Of measured modulators, before power and weights."""

    power: float = 1.0
    """That measured modulators are raised to: 0 lets regions count for nothing but their weights, 2 lets them count more."""

    motion: FileOption = None
    """Motion (.npz) to put beside the smaller avatar instead of the avatar's own."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Prune.

    Raises:
        SachaError: avatar, head, scores or budget make no sense, or do not belong together.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.sources import open_avatar
    from sacha_core.density.rebudget import rebudget
    from sacha_core.density.scores_file import read_scores
    from sacha_core.regions.labels import label_triangles
    from sacha_core.regions.scheme import find_scheme

    require_one_budget(options)
    path = options.scores or stored_scores(options.avatar)
    scores = read_scores(path)
    scheme = find_scheme(scores.scheme)
    budget = budget_of(options, len(scores.score), scheme)
    opened = open_avatar(options.avatar, options.head, options.motion)
    if opened.head.n_faces != scores.n_faces:
        raise TopologyError(
            f"{path} is of a head of {scores.n_faces} triangles, but {options.avatar} is bound to {opened.head.name!r} of "
            f"{opened.head.n_faces}"
        )
    found = rebudget(scores, label_triangles(opened.head, scheme), len(scheme.regions), budget)
    kept = scores.gaussians.select(found.rows)
    if (
        opened.avatar.gaussians.sensitivity_logit is None
    ):  # the scores hold estimates, which nobody shall take for learned
        kept = replace(kept, sensitivity_logit=None)
    write(options, opened, kept)
    console.wrote("avatar", options.output, f"{len(kept):,} of {len(scores.score):,} Gaussians")
    console.say(f"\n{region_table(found, scheme)}")
    console.hint(f"sacha encode {encode_arguments(options)}")
    return report(found, scheme, scores, path, options)


def require_one_budget(options: Options) -> None:
    """Check that the budget is given once, and that the output is not the avatar itself.

    Raises:
        OptionError: it is not, or given twice.
    """
    given = [name for name in ("keep", "ratio", "target_count") if getattr(options, name) is not None]
    if len(given) != 1:
        named = " and ".join(f"--{name.replace('_', '-')}" for name in given) or "none"
        raise OptionError(f"expected one of --keep, --ratio and --target-count, got {named}")
    if options.output.exists() and options.output.samefile(options.avatar):
        raise OptionError(f"-o {options.output} is the avatar itself; expected another place")


def stored_scores(avatar: Path) -> Path:
    """Find the scores of an avatar: what `sacha score` wrote, else what training left in a model folder.

    Raises:
        OptionError: there are none; the message says how to make them.
    """
    measured, trained = beside(avatar), avatar / "avatar.scores.npz"
    for path in (measured, trained):
        if path.is_file():
            return path
    raise OptionError(
        f"{measured} does not exist; make it with: sacha score {avatar} -o {measured}, or name one with --scores"
    )


def budget_of(options: Options, n: int, scheme: RegionScheme) -> Budget:
    """Give the budget that was asked for.

    Raises:
        OptionError: a number is out of range, or a weight is none.
    """
    from sacha_core.density.rebudget import Budget

    weights = parsed_weights(options.weights, scheme)
    if options.ratio is not None and not 0 <= options.ratio < 1:
        raise OptionError(f"--ratio is {options.ratio:g}, expected 0 or more and below 1")
    if options.keep is not None and not 0 < options.keep <= 1:
        raise OptionError(f"--keep is {options.keep:g}, expected above 0 and at most 1")
    if options.target_count is not None and not 1 <= options.target_count <= n:
        raise OptionError(f"--target-count is {options.target_count}, expected 1 to {n}, which the scores file holds")
    keep = options.keep
    if options.ratio is not None:
        keep = 1 - options.ratio
    if options.target_count is not None:
        keep = options.target_count / n
    assert keep is not None
    return Budget(keep, weights, *options.bounds, scope=options.scope, power=options.power)


def parsed_weights(texts: Sequence[str], scheme: RegionScheme) -> dict[int, float]:
    """Give the weights by region label.

    Raises:
        OptionError: naming the first that is not REGION=FACTOR.
    """
    weights: dict[int, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            factor = float(number)
        except ValueError:
            factor = -1.0
        if not 0 < factor < float("inf"):
            raise OptionError(f"--weights {text}: expected REGION=FACTOR with a factor above 0, such as mouth=2")
        label = scheme.label(name)
        if label in weights:
            raise OptionError(f"--weights gives {name} twice")
        weights[label] = factor
    return weights


def write(options: Options, opened: Opened, kept: Gaussians) -> None:
    """Write the smaller avatar.

    Raises:
        OptionError: the folder holds another model.
        OSError: a file cannot be written.
    """
    from sacha_core.interchange.capture import write_head_reference
    from sacha_core.interchange.gaussian_avatars import model_iterations, write_model
    from sacha_core.interchange.splat_ply import write_bound_ply

    if options.output.suffix.lower() == ".ply":
        write_bound_ply(options.output, kept)
        return
    iteration = max(model_iterations(options.avatar), default=ITERATION) if options.avatar.is_dir() else ITERATION
    if others := sorted(model_iterations(options.output).keys() - {iteration}):
        raise OptionError(f"{options.output} holds another model, of {others[-1]} iterations; expected a new folder")
    write_head_reference(options.output, opened.avatar.head)
    write_model(options.output, iteration, kept, opened.avatar.motion)


def encode_arguments(options: Options) -> str:
    """Give what `sacha encode` needs to go on from here."""
    target = options.output.with_suffix(".sacha")
    if options.output.suffix.lower() != ".ply":
        return f"{options.output} -o {target}"
    motion = "" if options.motion is None else f" --motion {options.motion}"
    return f"--ply {options.output} --head {options.head.head or 'HEAD'}{motion} -o {target}"


def region_table(found: Rebudget, scheme: RegionScheme) -> str:
    """Set what each region kept as a table."""
    rows = [
        (row["region"], f"{row['before']:,}", f"{row['after']:,}", f"{row['kept']:.1%}", f"{row['modulator']:.3f}")
        for row in regions(found, scheme)
    ]
    return table(("region", "before", "after", "kept", "m_R / weight"), rows)


def regions(found: Rebudget, scheme: RegionScheme) -> list[Mapping[str, Any]]:
    """Give what each region kept."""
    counts = zip(scheme.regions, found.pruning.before, found.pruning.after, found.modulator.tolist(), strict=True)
    return [
        {"region": name, "before": before, "after": after, "kept": after / max(before, 1), "modulator": modulator}
        for name, before, after, modulator in counts
    ]


def report(found: Rebudget, scheme: RegionScheme, scores: Scores, path: Path, options: Options) -> dict[str, Any]:
    """Give the report for machines."""
    return {
        "avatar": options.avatar,
        "scores": path,
        "output": options.output,
        "n_before": len(scores.score),
        "n_gaussians": len(found.rows),
        "scope": options.scope,
        "regions": regions(found, scheme),
    }
