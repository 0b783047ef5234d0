"""What `sacha bench codec` compares codecs on: avatars, or any splats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sacha_core.cli.common import HeadSource
from sacha_core.errors import OptionError

if TYPE_CHECKING:
    from sacha_core.avatar.avatar import Avatar
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.bench.preset import Subject
    from sacha_core.flame.model import HeadModel

__all__ = ["Sources", "subjects_of"]

FAR_M = 0.05  # from the head: hair may be, a room is
LOST = 0.5  # share of Gaussians that are far, from which on the scene does not stand where the head is


@dataclass(frozen=True)
class Sources:
    """What was said about the avatars to compare codecs on.

    Args:
        paths: avatars (.sacha, model folder, .ply of bound Gaussians) or splats (.ply).
        head: of the PLYs, or of the only avatar.
        motion: that avatars without one are posed by; None for none.
        with_truth: whether a capture was named, which only avatars have.
    """

    paths: Sequence[Path]
    head: HeadSource
    motion: Path | None
    with_truth: bool


def subjects_of(sources: Sources) -> tuple[Subject, ...]:
    """Open them.

    Raises:
        SachaError: one is broken, its head is not to be found, or it cannot be what the options say.
        OSError: a file cannot be read.
    """
    from sacha_core.interchange.splat_ply import is_bound_ply

    found = []
    for path in sources.paths:
        is_ply = path.is_file() and path.suffix.lower() == ".ply"
        if is_ply and not is_bound_ply(path):
            found.append(splats_of(path, sources))
        else:
            found.append(avatar_of(path, sources, is_ply))
    return tuple(found)


def avatar_of(path: Path, sources: Sources, is_ply: bool) -> Subject:
    """Open an avatar; the motion that was named is for one that brings none."""
    from sacha_core.bench.preset import Subject
    from sacha_core.cli.sources import open_avatar

    own = sources.head if is_ply or len(sources.paths) == 1 else HeadSource(masks=sources.head.masks)
    opened = open_avatar(path, own)
    if opened.avatar.motion is not None:
        return Subject(opened.avatar, opened.head, path)
    moved, how = moving(opened.avatar, opened.head, sources.motion)
    return Subject(moved, opened.head, path, note=f"{path.name} brings no motion; it is posed {how}.")


def splats_of(path: Path, sources: Sources) -> Subject:
    """Open splats that are bound to nothing: onto the head that was named, or as they stand."""
    from sacha_core.bench.codec_free import free_subject
    from sacha_core.bench.preset import Subject
    from sacha_core.cli.sources import keep, named_head
    from sacha_core.interchange.splat_ply import read_world_ply

    splats, head = read_world_ply(path), named_head(sources.head)
    if head is None:
        for name, given in (("--motion", sources.motion), ("--dataset", sources.with_truth)):
            if given:
                raise OptionError(
                    f"{name} belongs to an avatar, and {path} is bound to no head; name one with --head HEAD"
                )
        return free_subject(splats, path)
    keep(head)
    avatar, note = bound_at_rest(path, splats, head)
    moved, how = moving(avatar, head, sources.motion)
    return Subject(moved, head, path, note=f"{note}; it is posed {how}.")


def moving(avatar: Avatar, head: HeadModel, motion: Path | None) -> tuple[Avatar, str]:
    """Give an avatar a motion, and say which: the named one, or else stock expressions."""
    from sacha_core.cli.sources import open_motion
    from sacha_core.rate.stances import stock_motion

    if motion is not None:
        return replace(avatar, motion=open_motion(motion, head)), f"by {motion.name}"
    return replace(avatar, motion=stock_motion(head)), "in stock expressions, for want of --motion FILE"


def bound_at_rest(path: Path, splats: Gaussians, head: HeadModel) -> tuple[Avatar, str]:
    """Bind splats to the head at rest as `sacha bind` does, and say how well they fit.

    Raises:
        OptionError: they hardly stand where the head is.
    """
    import numpy as np

    from sacha_core.animation.splat_binding import bound_to, nearest_binding, subdivided
    from sacha_core.avatar.avatar import Avatar

    nearest, distance_m = nearest_binding(splats.position, head.v_template, head.faces)
    n_far = int((distance_m > FAR_M).sum())
    if n_far > LOST * len(splats):
        raise OptionError(
            f"{path}: {n_far:,} of {len(splats):,} Gaussians are over {1000 * FAR_M:.0f} mm from the head at rest; bind them with "
            "`sacha bind`, which scales, turns and poses first, or leave --head out"
        )
    mesh = subdivided(head)
    own = mesh.binding if len(mesh.binding) == len(splats) else nearest
    bound = bound_to(splats, own, head.v_template, head.faces)
    half, far = 1000 * float(np.median(distance_m)), f", {n_far:,} over {1000 * FAR_M:.0f} mm" if n_far else ""
    note = f"{path.name} was bound to head {head.name!r} at rest, half of it within {half:.1f} mm{far}"
    return Avatar(bound, head.reference), note
