"""What `sacha prune` makes and writes: a PLY, a model folder, or a file of a level or a size."""

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

__all__ = ["Pruned", "prune", "write_pruned"]

ITERATION = 1  # a folder of a model names its iterations; a PLY has had none that are known
USUAL_LEVEL = 2


class Pruned(NamedTuple):
    """A smaller avatar that nobody has written yet.

    Args:
        found: who stayed.
        gaussians: as whoever opens it will find them.
        data: the file; None where it is made from the Gaussians.
        quality: the level that it was made at; None where it has none.
        n_trials: encodings that it took.
    """

    found: Rebudget
    gaussians: Gaussians
    data: bytes | None = None
    quality: float | None = None
    n_trials: int = 0


def prune(
    options: Options, opened: Opened, scores: Scores, partition: Partition, budget: Budget, console: Console
) -> Pruned:
    """Choose who stays, and encode that where a file is wanted.

    Raises:
        OptionError: the budget cannot be kept to, or the size is out of reach.
        SachaError: the avatar cannot be compressed.
    """
    from sacha_core.codec import encode_archive
    from sacha_core.density.rebudget import rebudget

    compressed = options.output.suffix.lower() == ".sacha"
    if compressed and options.level != "archive":
        return prune_by_rendering(options, opened, scores, partition, budget, console)
    found = rebudget(scores, partition, budget)
    kept = scores.gaussians.select(found.rows)
    if (
        opened.avatar.gaussians.sensitivity_logit is None
    ):  # the scores hold estimates, which nobody shall take for learned
        kept = replace(kept, sensitivity_logit=None)
    if not compressed:
        return Pruned(found, kept)
    data = encode_archive(replace(opened.avatar, gaussians=kept), head=opened.head, embed_head=options.embed_head)
    return Pruned(found, kept, data, None, 1)


def write_pruned(options: Options, opened: Opened, pruned: Pruned) -> int | None:
    """Write it; give the bytes of the file, None of a folder.

    Raises:
        OptionError: the folder holds another model.
        OSError: a file cannot be written.
    """
    from sacha_core.files import write_aside
    from sacha_core.interchange.splat_ply import write_bound_ply

    if pruned.data is not None:
        with write_aside(options.output) as aside:
            aside.write_bytes(pruned.data)
    elif options.output.suffix.lower() == ".ply":
        write_bound_ply(options.output, pruned.gaussians, pruned.gaussians.sh_degree)
    else:
        write_folder(options, opened, pruned.gaussians)
        return None
    return options.output.stat().st_size


def prune_by_rendering(
    options: Options, opened: Opened, scores: Scores, partition: Partition, budget: Budget, console: Console
) -> Pruned:
    """Encode by rendering, at a level or to a size."""
    from sacha_core.codec import decode
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
    decoded = decode(encoded.data, head=head).gaussians
    return Pruned(encoder.choose(encoded.level), decoded, encoded.data, encoded.level.quality, n_trials)


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
