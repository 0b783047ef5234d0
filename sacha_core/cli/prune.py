"""`sacha prune`: a smaller avatar from an avatar and its scores, without training."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import tyro

from sacha_core.cli.common import Common, FileOption, HeadSource, MaybeFloat, MaybeInt, MaybePath, MaybeText
from sacha_core.cli.console import Console, kilobytes
from sacha_core.cli.prune_scores import stored_scores
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.cli.pruned import Pruned

__all__ = ["INPUTS", "OUTPUT_FOLDERS", "Options", "run", "stored_scores"]

INPUTS = ("avatar", "motion", "scheme", "importance", "dataset", "before")
OUTPUT_FOLDERS = ("scene",)

MaybeLevel = Union[None, Literal[1, 2, 3, 4, "archive"]]  # noqa: UP007 (tyro understands it by itself)


@dataclass(frozen=True)
class Options:
    """Cut an avatar down to a budget by its scores, sparing the regions that matter.

    Takes the Gaussians from the scores file: of a trained model, those that it had before its last pruning, untrained since; `sacha score
    MODEL --dataset DATASET` scores the finished ones. One ranking decides over all Gaussians; what no view shows goes first. A .sacha file
    holds exactly those that stay, coded by what they are worth to pictures.

    sacha prune a.ply --head rig.npz --masks FLAME_masks.npz --keep 0.6 --weights mouth=2 eyes=1.5 -o smaller.ply

    sacha prune a.sacha --make-scores --target-size 60KB --weights mouth=2 --lock eyes --shares neck=0:0.05 -o smaller.sacha
    """

    avatar: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AVATAR")]
    """What was scored: a .sacha file, a model folder, or a PLY of bound Gaussians (with --head)."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="OUT")]
    """By its ending: a compressed .sacha file, a .ply of bound Gaussians, else a model folder in the layout of GaussianAvatars."""

    scores: Annotated[FileOption, tyro.conf.arg(help_behavior_hint="(default: AVATAR.scores.npz beside it)")] = None
    """What `sacha score` wrote; of a model folder that was never scored, what training left in it."""

    make_scores: bool = False
    """Where there are none, or they are of other Gaussians than the avatar has, measure them first as `sacha score` does, and keep them."""

    views: Annotated[int, tyro.conf.arg(metavar="N")] = 120
    """About how many views scores are made from."""

    keep: Annotated[
        MaybeFloat,
        tyro.conf.arg(metavar="SHARE", help_behavior_hint="(this, --ratio, --target-count or --target-size)"),
    ] = None
    """How much stays: 0.6 keeps six Gaussians of ten."""

    ratio: Annotated[MaybeFloat, tyro.conf.arg(metavar="SHARE", help_behavior_hint="")] = None
    """How much goes: 0.4 is --keep 0.6."""

    target_count: Annotated[MaybeInt, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """How many Gaussians stay."""

    weights: Annotated[tuple[str, ...], tyro.conf.arg(metavar="REGION=FACTOR...", help_behavior_hint="")] = ()
    """How much more regions are worth than measured: mouth=2 counts each of the mouth's scores twice."""

    shares: Annotated[tuple[str, ...], tyro.conf.arg(metavar="REGION=LOWEST:HIGHEST...", help_behavior_hint="")] = ()
    """Least and most that regions have of what stays: mouth=0.1:0.3, neck=:0.05."""

    lock: Annotated[tuple[str, ...], tyro.conf.arg(metavar="REGION[=COUNT]...", help_behavior_hint="")] = ()
    """Regions that keep all their Gaussians, or so many of them, whatever the budget."""

    importance: FileOption = None
    """Array (.npy) of how many times as much triangles are worth: a number for each, or for each vertex, or linear colours of these."""

    importance_strength: Annotated[MaybeFloat, tyro.conf.arg(metavar="FACTOR", help_behavior_hint="")] = None
    """Take the array as painted from 0, which counts once, to 1, which counts so many times."""

    scheme: FileOption = None
    """Regions of one's own (.scheme.npz) instead of the avatar's."""

    scope: Literal["weighted", "regions", "all"] = "weighted"
    """weighted: one ranking, by score over the region's modulator; regions: each region loses its own share, as in the paper, so that
    the total is near the budget only; all: one ranking by score alone."""

    bounds: Annotated[tuple[float, float], tyro.conf.arg(metavar="LOWEST HIGHEST")] = (0.5, 2.0)
    """Of measured modulators, before power and weights."""

    power: float = 1.0
    """That measured modulators are raised to: 0 lets regions count for nothing but their weights, 2 lets them count more."""

    level: Annotated[MaybeLevel, tyro.conf.arg(help_behavior_hint="(default: 2)")] = None
    """Of a .sacha file: 1 is the smallest, 4 the best; `archive` keeps every bit."""

    target_size: Annotated[MaybeText, tyro.conf.arg(metavar="SIZE", help_behavior_hint="(instead of --level)")] = None
    """The best .sacha file of at most this size, motion and all: 60KB. Without another budget, as many stay as are worth their bits."""

    embed_head: bool = False
    """Put the head into the .sacha file too."""

    motion: FileOption = None
    """Motion (.npz) to put beside the smaller avatar instead of the avatar's own."""

    measure: bool = False
    """Measure, region by region, how near the result's pictures come to the avatar's own, or to the held-out ones of --dataset."""

    dataset: Annotated[MaybePath, tyro.conf.arg(metavar="DATASET", help_behavior_hint="")] = None
    """The capture that it was trained on, whose views to score it by and to measure it against."""

    before: Annotated[MaybePath, tyro.conf.arg(metavar="AVATAR", help_behavior_hint="(default: the avatar itself)")] = (
        None
    )
    """An earlier result to set beside this one."""

    scene: Annotated[MaybePath, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Also lay out the result as arrays, as the Blender add-on shows them."""

    head: HeadSource = field(default_factory=HeadSource)
    common: Common = field(default_factory=Common)


def run(options: Options, console: Console) -> dict[str, Any]:
    """Prune.

    Raises:
        SachaError: avatar, head, scores or budget make no sense, or do not belong together.
        OSError: a file cannot be read or written.
    """
    from sacha_core.cli.prune_report import judge, region_table, report
    from sacha_core.cli.prune_scores import scores_of
    from sacha_core.cli.pruned import prune, write_pruned
    from sacha_core.cli.sources import open_avatar
    from sacha_core.cli.steering import budget_of, partition_of
    from sacha_core.interchange.capture import read_capture

    require_consistent(options)
    opened = open_avatar(options.avatar, options.head, options.motion)
    before = opened if options.before is None else open_avatar(options.before, options.head)
    capture = None if options.dataset is None else read_capture(options.dataset)
    path, scores = scores_of(options, opened, capture, console)
    partition = partition_of(opened.head, options.scheme, scores.scheme)
    budget = budget_of(options, len(scores.score), partition, opened.head)
    pruned = prune(options, opened, scores, partition, budget, console)
    judged = judge(options, opened, before, pruned, capture, partition, console)
    n_bytes = write_pruned(options, opened, pruned)
    n_kept, n_scored = len(pruned.found.rows), len(scores.score)
    console.wrote("avatar", options.output, f"{n_kept:,} of {n_scored:,} Gaussians{size_of(pruned)}")
    console.say(f"\n{region_table(judged)}")
    if pruned.data is None:
        console.hint(f"sacha encode {encode_arguments(options)}")
    if options.scene is not None:
        lay_out(options, path)
    return report(options, pruned, n_bytes, scores, path, partition, judged)


def require_consistent(options: Options) -> None:
    """Check that the budget is given once, that the output is another file, and that nothing is said that the output cannot have.

    Raises:
        OptionError: naming what contradicts what.
        OSError: the output cannot be written.
    """
    from sacha_core.files import require_writable, require_writable_folder

    given = [name for name in ("keep", "ratio", "target_count") if getattr(options, name) is not None]
    if len(given) > 1 or not (given or options.target_size):
        named = " and ".join(f"--{name.replace('_', '-')}" for name in given) or "none"
        raise OptionError(f"expected one of --keep, --ratio and --target-count, or --target-size, got {named}")
    for path, what in ((options.avatar, "the avatar itself"), (options.before, "what it shall be set beside")):
        if path is not None and options.output.exists() and options.output.samefile(path):
            raise OptionError(f"-o {options.output} is {what}; expected another place")
    (require_writable if options.output.suffix.lower() in {".sacha", ".ply"} else require_writable_folder)(
        options.output
    )
    if options.output.suffix.lower() != ".sacha":
        for name in ("level", "target_size", "embed_head"):
            if getattr(options, name):
                raise OptionError(f"--{name.replace('_', '-')} is of .sacha files, and -o {options.output} is none")
    if options.target_size is not None and options.level is not None:
        raise OptionError("--level says how good the file is, and so does --target-size; expected one of them")
    if options.dataset is not None and not (options.measure or options.make_scores):
        raise OptionError("--dataset is for --measure and --make-scores; expected one of these with it")
    if options.views < 1:
        raise OptionError(f"--views is {options.views}, expected at least 1")


def lay_out(options: Options, scores: Path) -> None:
    """Write the result as a scene, beside what was before."""
    from sacha_core.cli.scene import Extras, open_scene
    from sacha_core.scene.folder import write_scene

    assert options.scene is not None
    extras = Extras(scores, options.before or options.avatar, options.scheme)
    write_scene(open_scene(options.output, options.head, extras), options.scene)


def size_of(pruned: Pruned) -> str:
    """Say how large the file is and how good."""
    if pruned.data is None:
        return ""
    level = "archive" if pruned.quality is None else f"level {pruned.quality:g}"
    return f", {level}, {kilobytes(len(pruned.data))}"


def encode_arguments(options: Options) -> str:
    """Give what `sacha encode` needs to go on from here."""
    target = options.output.with_suffix(".sacha")
    if options.output.suffix.lower() != ".ply":
        return f"{options.output} -o {target}"
    motion = "" if options.motion is None else f" --motion {options.motion}"
    return f"--ply {options.output} --head {options.head.head or 'HEAD'}{motion} -o {target}"
