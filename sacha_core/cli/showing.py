"""What there is to show of an avatar: itself, its scores, its file's bytes, and another avatar to compare it with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sacha_core.cli.common import HeadSource, naming
from sacha_core.cli.console import kilobytes
from sacha_core.cli.prune_scores import stored_scores
from sacha_core.cli.sources import Opened, open_avatar, with_coordinates
from sacha_core.codec.spending import spent_bytes
from sacha_core.density.scores_file import Scores, read_scores
from sacha_core.errors import OptionError, TopologyError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme_file import read_scheme_file
from sacha_core.scene.avatar_views import Shown
from sacha_core.scene.contents import Scene, scene_of_avatar

if TYPE_CHECKING:
    from sacha_core.cli.scene import Extras

__all__ = ["regions_of", "scene_of_opened", "shown_of"]


def scene_of_opened(path: Path, opened: Opened, source: HeadSource, extras: Extras) -> Scene:
    """Show an avatar that was opened, with all that is known of it.

    Raises:
        SachaError: scores, regions, or the avatar to compare with are damaged or of another head.
        OSError: a file cannot be read.
    """
    head = with_coordinates(opened.head)
    shown = shown_of(path, opened, extras.scores)
    compared = None if extras.compare is None else _compared(extras.compare, source, head)
    scene = scene_of_avatar(shown, opened.avatar, head, regions_of(extras.scheme, head), compared)
    return replace(scene, facts=[*scene.facts, kilobytes(path.stat().st_size)]) if path.is_file() else scene


def regions_of(scheme: Path | None, head: HeadModel) -> Partition | None:
    """Read regions from a file, where one is named.

    Raises:
        FormatError, HeadError: it is damaged, or of another head.
    """
    return None if scheme is None else read_scheme_file(scheme, head)


def shown_of(path: Path, opened: Opened, scores: Path | None = None) -> Shown:
    """Collect what is known of an avatar: its scores, named or beside it, and the bytes of each triangle in a `.sacha` file.

    Raises:
        FormatError: the scores file or the avatar is damaged.
        TopologyError: the named scores are of another head.
        OSError: a file cannot be read.
    """
    spent = None
    if opened.kind == "sacha":
        with naming(path):
            spent = spent_bytes(path, head=opened.head).triangles
    return Shown(path.stem, opened.avatar.gaussians, _scores_of(path, opened.head, scores), spent)


def _scores_of(path: Path, head: HeadModel, named: Path | None) -> Scores | None:
    """Read the scores that are named, or those beside the avatar; those beside it may be of something else, and then count for nothing."""
    try:
        found = named or stored_scores(path)
    except OptionError:  # there are none
        return None
    scores = read_scores(found)
    if scores.n_faces == head.n_faces:
        return scores
    if named is not None:
        raise TopologyError(f"{named} is of a head of {scores.n_faces} triangles, but {head.name!r} has {head.n_faces}")
    return None


def _compared(path: Path, source: HeadSource, head: HeadModel) -> Shown:
    """Open the avatar to compare with.

    Raises:
        TopologyError: it is bound to other triangles.
    """
    other = open_avatar(path, source)
    if not np.array_equal(other.head.faces, head.faces):
        raise TopologyError(
            f"{path} is bound to {other.head.name!r} of {other.head.n_faces} triangles, expected those of {head.name!r} "
            f"({head.n_faces}): only avatars of one head can be compared"
        )
    return shown_of(path, other)
