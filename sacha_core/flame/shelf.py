"""The user's folder of heads: whatever head was used once is found again by its digest."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.errors import HeadError, MissingHeadError, TopologyError
from sacha_core.flame.head_file import load_head, save_head
from sacha_core.flame.model import HeadModel, HeadReference
from sacha_core.flame.open import open_head, open_synthetic
from sacha_core.flame.teeth import FLAME_VERTICES
from sacha_core.flame.unwrap import unwrapped
from sacha_core.npz import read_npz, write_npz

__all__ = ["find_head", "heads_with", "remember", "shelf_folder", "unwrapped_once"]

VARIABLE = "SACHA_HEADS"
COORDINATES = ".uv.npz"  # how the names of files end that hold a head's texture coordinates alone
LARGE = (
    "v_template",
    "shapedirs",
    "exprdirs",
    "J_regressor",
    "weights",
    "posedirs",
    "uv",
    "uv_faces",
)  # not needed to compare triangles


def shelf_folder() -> Path:
    """Give the folder: the environment variable SACHA_HEADS, or `~/.cache/sacha/heads`. It need not exist.

    Raises:
        HeadError: neither the variable is set nor has the user a home folder.
    """
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    try:
        return Path.home() / ".cache" / "sacha" / "heads"
    except RuntimeError as error:
        raise HeadError(
            f"no home folder to keep heads in: set the environment variable {VARIABLE} to a folder"
        ) from error


def remember(head: HeadModel) -> Path | None:
    """Keep a head for later; one with masks replaces the same one without.

    Returns:
        Its file, or None for a synthetic head, which its name is enough to make again.

    Raises:
        HeadError: the head contradicts itself.
        OSError: the folder cannot be written.
    """
    made = open_synthetic(head.name)
    if made is not None and made.reference == head.reference:
        return None
    path = shelf_folder() / f"{head.reference.sha256}.npz"
    if not path.is_file() or (head.masks and not load_head(path).masks):
        save_head(head, path)
    return path


def find_head(
    reference: HeadReference,
    explicit: str | os.PathLike[str] | None = None,
    embedded: HeadModel | None = None,
    masks: str | os.PathLike[str] | None = None,
) -> HeadModel:
    """Find the head that an avatar is bound to: the one named, else the one inside the file, else one used before, else made anew.

    Args:
        reference: which head it must be.
        explicit: what the user names: a file, or a synthetic head.
        embedded: the head inside the avatar's file.
        masks: file of FLAME's vertex masks, for a head named by the user that brings none.

    Raises:
        HeadError: there is none, or the one named or embedded is another; the message says which is needed and how to give it.
        FormatError: a file is damaged.
        OSError: a file cannot be read.
    """
    if explicit is not None:
        return _same(reference, open_head(explicit, masks, teeth=reference.n_vertices != FLAME_VERTICES), f"{explicit}")
    if embedded is not None:
        return _same(reference, embedded, "the head inside the file")
    path = shelf_folder() / f"{reference.sha256}.npz"
    if len(reference.sha256) == 64 and reference.sha256.isalnum() and path.is_file():
        return _same(reference, load_head(path), f"{path}")
    made = open_synthetic(reference.name)
    if made is not None:
        return _same(reference, made, f"the head that {reference.name!r} names here")
    raise MissingHeadError(
        f"head {reference.name!r} ({reference.n_vertices} vertices, {reference.n_faces} triangles, SHA-256 {reference.sha256[:12]}...)"
        f" is neither in the file nor in {shelf_folder()}; name it with --head FILE"
    )


def heads_with(faces: Int[np.ndarray, "f 3"]) -> list[HeadModel]:
    """Give the user's heads that have these triangles in this order, with or without their teeth, which come last.

    Raises:
        FormatError: a file of the folder is damaged.
        HeadError: a head of the folder contradicts itself.
        OSError: the folder cannot be read.
    """
    found = []
    for path in sorted(shelf_folder().glob("*.npz")):
        if path.name.endswith(COORDINATES):
            continue
        kept = read_npz(path, skip=LARGE)
        n_teeth = int(kept["n_teeth_faces"]) if "n_teeth_faces" in kept else 0
        of_head = kept.get("faces", np.zeros((0, 3), np.int32))
        if len(faces) in {len(of_head), len(of_head) - n_teeth} and np.array_equal(faces, of_head[: len(faces)]):
            found.append(load_head(path))
    return found


def unwrapped_once(head: HeadModel) -> HeadModel:
    """Give a head with texture coordinates, made at most once: they are kept beside the user's heads.

    Raises:
        FormatError: the file in which they are kept is damaged.
        HeadError: it is of another head.
        OSError: the folder cannot be read or written.
    """
    path = shelf_folder() / f"{head.reference.sha256}{COORDINATES}"
    if path.is_file():
        kept = read_npz(path)
        found = replace(head, uv=kept.get("uv"), uv_faces=kept.get("uv_faces"))
        found.validate()
        return found
    made = unwrapped(head)
    if made.uv is not None and made.uv_faces is not None:
        write_npz(path, {"uv": made.uv, "uv_faces": made.uv_faces})
    return made


def _same(reference: HeadReference, head: HeadModel, where: str) -> HeadModel:
    if head.reference.sha256 == reference.sha256:
        return head
    raise TopologyError(
        f"{where} is not the head that the avatar is bound to: found {head.name!r}, {head.n_vertices} vertices, {head.n_faces} triangles,"
        f" SHA-256 {head.reference.sha256[:12]}..., expected {reference.name!r}, {reference.n_vertices}, {reference.n_faces},"
        f" {reference.sha256[:12]}..."
    )
