"""Opening an avatar from whatever holds one: a `.sacha` file, a model folder, or a splat PLY with its head."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.common import HeadSource, naming
from sacha_core.cli.program import one_line
from sacha_core.codec import decode, embedded_head, inspect
from sacha_core.errors import FormatError, HeadError, MissingHeadError, SachaError
from sacha_core.flame.model import HeadModel, HeadReference
from sacha_core.flame.open import attach_masks, open_head
from sacha_core.flame.posing import Poser
from sacha_core.flame.shelf import find_head, remember, unwrapped_once
from sacha_core.flame.unwrap import unwrapped
from sacha_core.interchange.capture import Capture, read_head_reference
from sacha_core.interchange.gaussian_avatars import fitted_offsets, read_model
from sacha_core.interchange.motion_file import read_motion
from sacha_core.interchange.splat_ply import read_bound_ply

__all__ = [
    "Opened",
    "capture_head",
    "decode_file",
    "keep",
    "named_head",
    "open_avatar",
    "open_motion",
    "with_coordinates",
]


@dataclass(frozen=True)
class Opened:
    """An avatar with the head that it is bound to.

    Args:
        avatar: Gaussians, motion, and what names the head.
        head: the head itself.
        kind: what it was opened from.
    """

    avatar: Avatar
    head: HeadModel
    kind: Literal["sacha", "model", "ply"]


def open_avatar(path: Path, source: HeadSource, motion: Path | None = None) -> Opened:
    """Open an avatar and its head; the head goes to the user's head folder.

    Args:
        path: a `.sacha` file, a model folder, or a `.ply` of bound Gaussians.
        source: what was said about the head; a PLY needs it, the others know the name of theirs.
        motion: file of a motion, to play instead of the one that comes with the avatar.

    Raises:
        SachaError: a file is damaged, or the head is not to be found or is not the avatar's.
        OSError: a file cannot be read.
    """
    if path.is_dir():
        opened = _open_model(path, source)
    elif path.suffix.lower() == ".ply":
        opened = _open_ply(path, source)
    else:
        opened = _open_sacha(path, source)
    if motion is None:
        return opened
    return replace(opened, avatar=replace(opened.avatar, motion=open_motion(motion, opened.head)))


def decode_file(path: Path, source: HeadSource) -> Avatar:
    """Decode a `.sacha` file; one that was made without its head needs none.

    Raises:
        FormatError: the file is damaged.
        HeadError: its head is needed and not to be found, or the named one is another.
        OSError: a file cannot be read.
    """
    with naming(path):
        reference = inspect(path).head
    head = None if source.head is None else _found(reference, source, None, None)
    with naming(path):
        return decode(path, head=head)


def named_head(source: HeadSource) -> HeadModel | None:
    """Give the head that the user names, with the masks that the user names; None where no head is named.

    Raises:
        HeadError: the head or the masks are damaged.
    """
    return None if source.head is None else open_head(source.head, masks=source.masks)


def capture_head(capture: Capture, source: HeadSource) -> HeadModel:
    """Give the head that a capture's parameters belong to: the named one, the one beside the capture, or one used before.

    Raises:
        HeadError: it is not to be found, or the named one is another.
    """
    if capture.head is None:
        return _named(source, f"{capture.root} has no head.json, which says what head it was tracked with")
    return _found(capture.head, source, capture.head_path, None)


def keep(head: HeadModel) -> None:
    """Remember a head for later; where that cannot be, which stops no work of now, say so on stderr."""
    try:
        remember(head)
    except (SachaError, OSError) as error:
        sys.stderr.write(f"warning: head {head.name!r} is not kept for later: {one_line(error)}\n")


def with_coordinates(head: HeadModel) -> HeadModel:
    """Give a head with texture coordinates; those made for one that has none are kept for later, which saves seconds."""
    if head.uv is not None:
        return head
    try:
        return unwrapped_once(head)
    except (SachaError, OSError) as error:
        sys.stderr.write(f"warning: texture coordinates of {head.name!r} are not kept for later: {one_line(error)}\n")
        return unwrapped(head)


def open_motion(path: Path, head: HeadModel) -> Motion:
    """Read a motion for a head: FLAME parameters, or weights of a rig's blend shapes.

    Raises:
        FormatError: the file holds no motion, or one of no frames.
        HeadError: the head cannot move so: it lacks components or vertices that the motion uses.
    """
    motion = fitted_offsets(read_motion(path, head), head.n_vertices)
    if len(motion) == 0:
        raise FormatError(f"{path} holds a motion of no frames")
    try:
        Poser(head, motion)
    except HeadError as error:
        raise HeadError(f"{path}: {error}") from error
    return motion


def _open_sacha(path: Path, source: HeadSource) -> Opened:
    with naming(path):
        reference, embedded = inspect(path).head, embedded_head(path)
    head = _found(reference, source, None, embedded)
    with naming(path):
        return Opened(decode(path, head=head), head, "sacha")


def _open_model(path: Path, source: HeadSource) -> Opened:
    gaussians, motion = read_model(path)
    is_iteration = path.parent.name == "point_cloud"
    reference, beside = read_head_reference(path.parents[1] if is_iteration else path)
    head = _found(reference, source, beside, None) if reference else _named(source, f"{path} has no head.json")
    return Opened(_bound(path, gaussians, head, motion), head, "model")


def _open_ply(path: Path, source: HeadSource) -> Opened:
    gaussians = read_bound_ply(path)
    head = _named(source, f"{path} does not say which head it is bound to")
    return Opened(_bound(path, gaussians, head, None), head, "ply")


def _bound(path: Path, gaussians: Gaussians, head: HeadModel, motion: Motion | None) -> Avatar:
    """Make an avatar whose bindings all lie on its head."""
    with naming(path):
        gaussians.validate(head.n_faces)
    fitted = None if motion is None else fitted_offsets(motion, head.n_vertices)
    return Avatar(gaussians, head.reference, fitted)


def _named(source: HeadSource, otherwise: str) -> HeadModel:
    """Give the head that the user names, where only the user can know it."""
    head = named_head(source)
    if head is None:
        raise MissingHeadError(f"{otherwise}: name it with --head HEAD")
    keep(head)
    return head


def _found(reference: HeadReference, source: HeadSource, beside: Path | None, embedded: HeadModel | None) -> HeadModel:
    """Find the head of a known hash: the named one, the one beside or inside, or one used before."""
    named = source.head if source.head is not None else beside
    head = find_head(reference, named, embedded, source.masks)
    if source.masks is not None and named is None:
        head = attach_masks(head, source.masks)
    keep(head)
    return head
