"""What `sacha prune` writes: a PLY, a model folder, or a file of a level or a size."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.cli.console import Console
    from sacha_core.cli.prune import Options
    from sacha_core.cli.sources import Opened
    from sacha_core.density.budget import Budget
    from sacha_core.density.rebudget import Rebudget
    from sacha_core.density.scores_file import Scores
    from sacha_core.regions.partition import Partition

__all__ = ["Written", "write_pruned"]

ITERATION = 1  # a folder of a model names its iterations; a PLY has had none that are known
USUAL_LEVEL = 2


class Written(NamedTuple):
    """What was written.

    Args:
        found: who stayed.
        gaussians: as whoever opens it will find them.
        n_bytes: of the file; None where it is none.
        quality: the level that it was made at; None where it has none.
        n_trials: encodings that it took.
    """

    found: Rebudget
    gaussians: Gaussians
    n_bytes: int | None = None
    quality: float | None = None
    n_trials: int = 0


def write_pruned(
    options: Options, opened: Opened, scores: Scores, partition: Partition, budget: Budget, console: Console
) -> Written:
    """Choose who stays, and write it.

    Raises:
        OptionError: the budget cannot be kept to, the size is out of reach, or the folder holds another model.
        SachaError: the avatar cannot be compressed.
        OSError: a file cannot be written.
    """
    suffix = options.output.suffix.lower()
    if suffix == ".sacha" and options.level != "archive":
        return write_rendered(options, opened, scores, partition, budget, console)
    from sacha_core.density.rebudget import rebudget

    found = rebudget(scores, partition, budget)
    kept = scores.gaussians.select(found.rows)
    if (
        opened.avatar.gaussians.sensitivity_logit is None
    ):  # the scores hold estimates, which nobody shall take for learned
        kept = replace(kept, sensitivity_logit=None)
    if suffix == ".sacha":
        return write_archive(options, opened, found, kept)
    if suffix == ".ply":
        from sacha_core.interchange.splat_ply import write_bound_ply

        write_bound_ply(options.output, kept)
        return Written(found, kept, options.output.stat().st_size)
    write_folder(options, opened, kept)
    return Written(found, kept)


def write_rendered(
    options: Options, opened: Opened, scores: Scores, partition: Partition, budget: Budget, console: Console
) -> Written:
    """Encode by rendering, at a level or to a size."""
    from sacha_core.codec import decode
    from sacha_core.files import write_aside
    from sacha_core.progress import Progress
    from sacha_core.rate.steered import SteeredEncoder
    from sacha_core.rate.target import encode_to_size, parse_size

    avatar, head = replace(opened.avatar, gaussians=scores.gaussians), opened.head
    fixed = any(value is not None for value in (options.keep, options.ratio, options.target_count))
    encoder = SteeredEncoder(avatar, head, scores, partition, budget, fixed, options.embed_head)
    if options.target_size is not None:
        reached = encode_to_size(encoder, parse_size(options.target_size), console.report)
        encoded, n_trials = reached.encoded, reached.n_trials
    else:
        assert options.level != "archive"
        console.report(Progress("encode", 0, 1))
        encoded, n_trials = encoder.encode(options.level or USUAL_LEVEL), 1
        console.report(Progress("encode", 1, 1))
    with write_aside(options.output) as aside:
        aside.write_bytes(encoded.data)
    decoded = decode(encoded.data, head=head).gaussians
    return Written(encoder.choose(encoded.level), decoded, len(encoded.data), encoded.level.quality, n_trials)


def write_archive(options: Options, opened: Opened, found: Rebudget, kept: Gaussians) -> Written:
    """Encode every bit of what stays."""
    from sacha_core.codec import encode_archive
    from sacha_core.files import write_aside

    data = encode_archive(replace(opened.avatar, gaussians=kept), head=opened.head, embed_head=options.embed_head)
    with write_aside(options.output) as aside:
        aside.write_bytes(data)
    return Written(found, kept, len(data), None, 1)


def write_folder(options: Options, opened: Opened, kept: Gaussians) -> None:
    """Write a model folder.

    Raises:
        OptionError: the folder holds another model.
        OSError: a file cannot be written.
    """
    from sacha_core.interchange.capture import write_head_reference
    from sacha_core.interchange.gaussian_avatars import model_iterations, write_model

    iteration = max(model_iterations(options.avatar), default=ITERATION) if options.avatar.is_dir() else ITERATION
    if others := sorted(model_iterations(options.output).keys() - {iteration}):
        raise OptionError(f"{options.output} holds another model, of {others[-1]} iterations; expected a new folder")
    write_head_reference(options.output, opened.avatar.head)
    write_model(options.output, iteration, kept, opened.avatar.motion)
