"""The scores that `sacha prune` goes by: those beside the avatar, or made first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sacha_core.errors import HeadError, OptionError, TopologyError

if TYPE_CHECKING:
    from sacha_core.cli.console import Console
    from sacha_core.cli.prune import Options
    from sacha_core.cli.sources import Opened
    from sacha_core.density.scores_file import Scores
    from sacha_core.interchange.capture import Capture
    from sacha_core.regions.partition import Partition

__all__ = ["scores_of", "stored_scores"]


def scores_of(options: Options, opened: Opened, capture: Capture | None, console: Console) -> tuple[Path, Scores]:
    """Read the avatar's scores, or make them where that was asked for.

    Raises:
        TopologyError: they are of another head.
        OptionError: there are none; the message says how to make them.
        SachaError: they cannot be made.
    """
    from sacha_core.density.scores_file import read_scores

    path = options.scores if options.scores is not None else find_scores(options)
    if path is None or (options.make_scores and not path.is_file()):
        return make_scores(options, opened, capture, console)
    scores = read_scores(path)
    if options.make_scores and measured_on_others(scores, opened):
        return make_scores(options, opened, capture, console)
    if opened.head.n_faces != scores.n_faces:
        raise TopologyError(
            f"{path} is of a head of {scores.n_faces} triangles, but {options.avatar} is bound to {opened.head.name!r} of "
            f"{opened.head.n_faces}"
        )
    return path, scores


def find_scores(options: Options) -> Path | None:
    """Find the scores; None where there are none and they shall be made.

    Raises:
        OptionError: there are none and they shall not.
    """
    try:
        return stored_scores(options.avatar)
    except OptionError:
        if options.make_scores:
            return None
        raise


def stored_scores(avatar: Path) -> Path:
    """Find the scores of an avatar: what `sacha score` wrote, else what training left in a model folder.

    Raises:
        OptionError: there are none; the message says how to make them.
    """
    from sacha_core.cli.score import beside

    measured, trained = beside(avatar), avatar / "avatar.scores.npz"
    for path in (measured, trained):
        if path.is_file():
            return path
    raise OptionError(
        f"{measured} does not exist; make it with: sacha score {avatar} -o {measured}, let --make-scores do so, or name one with --scores"
    )


def measured_on_others(scores: Scores, opened: Opened) -> bool:
    """Tell whether scores were measured, not trained, on other Gaussians than the avatar has: it was written anew since."""
    import numpy as np

    from sacha_core.density.events import Calibration

    if not all(isinstance(event, Calibration) for event in scores.events):
        return False
    now, then = opened.avatar.gaussians, scores.gaussians
    return any(not np.array_equal(getattr(now, name), getattr(then, name)) for name in ("binding", "position", "sh_dc"))


def make_scores(options: Options, opened: Opened, capture: Capture | None, console: Console) -> tuple[Path, Scores]:
    """Measure what each Gaussian is worth, and keep that beside the avatar, or where --scores says.

    Raises:
        SachaError: the avatar cannot be measured.
        OSError: the scores cannot be written.
    """
    from sacha_core.cli.score import beside
    from sacha_core.density.scores_file import write_scores
    from sacha_core.evaluate.importance import score_avatar
    from sacha_core.files import require_writable
    from sacha_core.train.options import TrainOptions

    chosen = TrainOptions()
    chosen = replace(chosen, importance=replace(chosen.importance, views=options.views))
    gaussians, motion = opened.avatar.gaussians, opened.avatar.motion
    partition = own_regions(options, opened)
    path = options.scores or beside(options.avatar)
    require_writable(path)
    scored = score_avatar(gaussians, opened.head, motion, capture, chosen, console.report, partition)
    write_scores(path, scored.scores)
    console.wrote("scores", path, f"{len(gaussians):,} Gaussians in {scored.n_views} views")
    return path, scored.scores


def own_regions(options: Options, opened: Opened) -> Partition | None:
    """Give the regions of --scheme where the head has no masks to make the usual ones from; None where it has.

    Raises:
        SachaError: the scheme file is damaged or another head's.
    """
    from sacha_core.regions.partition import partition_by
    from sacha_core.regions.scheme_file import read_scheme_file

    if options.scheme is None:
        return None
    try:
        partition_by(opened.head)
    except HeadError:
        return read_scheme_file(options.scheme, opened.head)
    return None
