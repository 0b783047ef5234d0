"""The head-model file: one `.npz` with the arrays of `HeadModel` under their own names."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.npz import as_float32, read_npz, write_npz

__all__ = ["head_from_arrays", "head_to_arrays", "is_head_archive", "load_head", "save_head"]

INTEGER = ("faces", "parents", "uv_faces")
OPTIONAL = ("posedirs", "uv", "uv_faces")
APART = ("name", "n_teeth_faces", "masks", "expression_names")
REQUIRED = tuple(f.name for f in fields(HeadModel) if f.name not in {*OPTIONAL, *APART})
MASK_PREFIX = "mask_"
MAX_NAME = 200


def save_head(head: HeadModel, path: str | os.PathLike[str]) -> None:
    """Write a head model; equal heads give equal bytes.

    Raises:
        HeadError: the head contradicts itself.
        OSError: the file cannot be written.
    """
    head.validate()
    write_npz(path, head_to_arrays(head))


def load_head(path: str | os.PathLike[str]) -> HeadModel:
    """Read and check a head model.

    Args:
        path: an `.npz` that `save_head` wrote. Unknown arrays in it are ignored.

    Returns:
        The head: float32 and int32, C-contiguous.

    Raises:
        FormatError: the file is not such an archive or lacks an array.
        HeadError: the arrays do not fit together, or hold indices out of range or numbers that are not finite.
        OSError: the file cannot be read.
    """
    file = Path(path)
    try:
        return head_from_arrays(read_npz(file), default_name=file.stem)
    except HeadError as error:
        raise HeadError(f"{file}: {error}") from error


def is_head_archive(arrays: Mapping[str, np.ndarray]) -> bool:
    """Tell whether arrays are meant as a head model's, complete or not."""
    return "v_template" in arrays


def head_to_arrays(head: HeadModel) -> dict[str, np.ndarray]:
    """Give a head's arrays by the names that they have in a file."""
    arrays = {"name": np.array(head.name), "n_teeth_faces": np.array(head.n_teeth_faces, np.int32)}
    for name in (*REQUIRED, *OPTIONAL):
        array = getattr(head, name)
        if array is not None:
            arrays[name] = np.ascontiguousarray(array, np.int32 if name in INTEGER else np.float32)
    if head.expression_names:
        arrays["expression_names"] = np.array(head.expression_names)
    return arrays | {MASK_PREFIX + name: mask.astype(np.int32) for name, mask in sorted(head.masks.items())}


def head_from_arrays(arrays: Mapping[str, np.ndarray], default_name: str) -> HeadModel:
    """Make a checked head of arrays by the names that they have in a file.

    Args:
        arrays: from a file, not trusted.
        default_name: for a head without a name of its own.

    Raises:
        FormatError: an array is missing or of a wrong kind.
        HeadError: the arrays do not fit together.
    """
    missing = [name for name in REQUIRED if name not in arrays]
    if missing:
        raise FormatError(f"head {default_name!r} lacks {', '.join(missing)}")
    head = HeadModel(
        name=_text(arrays["name"]) if "name" in arrays else default_name,
        masks={
            name.removeprefix(MASK_PREFIX): _numbers(name, array, integer=True)
            for name, array in arrays.items()
            if name.startswith(MASK_PREFIX)
        },
        n_teeth_faces=int(_numbers("n_teeth_faces", arrays["n_teeth_faces"].reshape(-1)[:1], integer=True).sum())
        if "n_teeth_faces" in arrays
        else 0,
        expression_names=tuple(map(_text, arrays.get("expression_names", np.zeros(0, "U")).reshape(-1))),
        **{
            name: _numbers(name, arrays[name], integer=name in INTEGER)
            for name in (*REQUIRED, *OPTIONAL)
            if name in arrays
        },
    )
    head.validate()
    return head


def _text(value: object) -> str:
    """Give a name as one line of text that a terminal shows and does not obey."""
    return "".join(letter for letter in str(value)[:MAX_NAME] if letter.isprintable())


def _numbers(name: str, array: np.ndarray, *, integer: bool) -> np.ndarray:
    """Cast to the head's own kind of number, refusing what would change in the cast."""
    if not (np.issubdtype(array.dtype, np.integer) or (not integer and np.issubdtype(array.dtype, np.floating))):
        raise FormatError(
            f"array {name!r} of the head is of {array.dtype}, expected {'whole' if integer else 'real'} numbers"
        )
    if not integer:
        return as_float32(array)
    limits = np.iinfo(np.int32)
    if array.size and not (int(array.min()) >= limits.min and int(array.max()) <= limits.max):
        raise FormatError(f"array {name!r} of the head holds numbers beyond 32 bits")
    return np.ascontiguousarray(array, np.int32)
