"""Opening a head from whatever a user names."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

from sacha_core.errors import FormatError, GeometryError, HeadError, MissingHeadError, SachaError, TopologyError
from sacha_core.flame.head_file import head_from_arrays, is_head_archive
from sacha_core.flame.model import HeadModel
from sacha_core.flame.pickles import flame_from_arrays, is_flame_archive, read_flame_pickle, read_masks
from sacha_core.flame.rig import is_rig_archive, rig_from_arrays
from sacha_core.flame.teeth import FLAME_VERTICES, add_teeth, is_flame
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.npz import read_npz

__all__ = ["attach_masks", "open_head", "open_synthetic"]

PICKLE_STARTS = (b"\x80", b"(", b"}")  # a dictionary, of protocol 2 and up, 0, or 1
SYNTHETIC = re.compile(r"synthetic(?:[:-](?P<size>full|small))?(?:[:-](?P<seed>\d{1,9}))?")


def open_head(
    source: str | os.PathLike[str], masks: str | os.PathLike[str] | None = None, *, teeth: bool = True
) -> HeadModel:
    """Open a head.

    Args:
        source: a head model or rig (`.npz`), FLAME (a pickle or `.npz`), or `synthetic`, `synthetic:small`, `synthetic:full:7`.
        masks: file of FLAME's vertex masks, for a head of FLAME's topology that brings none.
        teeth: add GaussianAvatars' teeth to FLAME, as its avatars expect.

    Returns:
        The head, checked.

    Raises:
        HeadError: there is no such file, or its arrays do not fit together, or the masks are of another topology.
        FormatError: the file is damaged or holds no head.
        GeometryError: a triangle has zero area.
        OSError: it cannot be read.
    """
    made = open_synthetic(os.fspath(source))
    head = made if made is not None else _open_file(Path(source), teeth=teeth)
    return head if masks is None else attach_masks(head, masks)


def open_synthetic(name: str) -> HeadModel | None:
    """Make the synthetic head of a name, the one it bears or the one a user gives; None where the name is no such."""
    match = SYNTHETIC.fullmatch(name)
    if match is None:
        return None
    from sacha_core.flame.synthetic.head import synthetic_head  # noqa: PLC0415  (only where it is asked for)

    return synthetic_head(match["size"] or "full", int(match["seed"] or 0))


def attach_masks(head: HeadModel, path: str | os.PathLike[str]) -> HeadModel:
    """Give a head of FLAME's topology FLAME's vertex masks; its identity for avatars stays the same.

    Raises:
        HeadError: the head is of another topology, or the masks are.
        FormatError: the file holds no masks.
        OSError: it cannot be read.
    """
    masks = read_masks(path)
    if not is_flame(head):
        raise TopologyError(
            f"{path}: FLAME's masks fit heads of FLAME's topology; {head.name!r} has {head.n_vertices} vertices, {head.n_faces} triangles"
        )
    for name, mask in masks.items():
        if mask.size and mask.max() >= FLAME_VERTICES:
            raise HeadError(f"{path}: mask {name!r} has vertex {mask.max()}, expected 0 to {FLAME_VERTICES - 1}")
    return replace(head, masks=masks)


def _open_file(path: Path, *, teeth: bool) -> HeadModel:
    if not path.is_file():
        raise MissingHeadError(
            f"no head {str(path)!r}: give a head model or rig (.npz), a FLAME pickle, or 'synthetic' (also 'synthetic:small')"
        )
    with path.open("rb") as stream:
        start = stream.read(2)
    if start.startswith(PICKLE_STARTS):
        head, from_flame = read_flame_pickle(path), True
    elif start == b"PK":
        head, from_flame = _open_archive(path)
    else:
        raise FormatError(f"{path}: neither an .npz archive (of a head model or a rig) nor a FLAME pickle", offset=0)
    try:
        triangle_frames(head.v_template, head.faces)
    except GeometryError as error:
        raise GeometryError(f"{path}: {error}") from error
    return add_teeth(head) if from_flame and teeth and is_flame(head) else head


def _open_archive(path: Path) -> tuple[HeadModel, bool]:
    """Give the head in an archive, and whether it is FLAME's own model, which comes without teeth."""
    pickled: dict[str, bytes] = {}
    arrays = read_npz(path, pickled=pickled)
    if is_flame_archive(arrays):
        return flame_from_arrays(arrays, pickled, path), True
    if pickled:
        raise FormatError(f"{path}: array {next(iter(pickled))!r} holds Python objects, which are never read")
    try:
        if is_head_archive(arrays):
            return head_from_arrays(arrays, path.stem), False
        if is_rig_archive(arrays):
            return rig_from_arrays(arrays, path.stem), False
    except SachaError as error:
        raise type(error)(f"{path}: {error}") from error
    held = ", ".join(list(arrays)[:8]) or "nothing"
    raise FormatError(
        f"{path}: holds neither a head model (v_template, faces, ...) nor FLAME (v_template, f, ...) nor a rig (verts, faces);"
        f" it holds {held}"
    )
