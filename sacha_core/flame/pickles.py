"""FLAME as its authors distribute it: the licensed pickles of 2020, 2023 and 2023 Open, and the vertex masks.

Some tools keep the same dictionary as an `.npz`, the sparse regressor of the joints as a pickle inside it; both are read alike.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Int

from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.unpickler import ArrayRecord, ChumpyRecord, SparseRecord, parse_pickle, read_pickle
from sacha_core.npz import as_float32, read_npz

__all__ = ["flame_from_arrays", "is_flame_archive", "read_flame_pickle", "read_masks"]

N_IDENTITY = 300  # of the directions of shape that a FLAME pickle holds in one array, the first are identity, the others expression
DEPTH = 8  # of chumpy operations on one another
MAX_MASKS = 1000  # FLAME has 14
MAX_REGRESSOR = 1 << 24  # entries; FLAME's has 25 thousand


def read_flame_pickle(path: str | os.PathLike[str], n_identity: int = N_IDENTITY) -> HeadModel:
    """Read a FLAME model, without running anything that the pickle says and without chumpy.

    Args:
        path: `flame2023.pkl`, `flame2023_no_jaw.pkl`, `flame2023_Open.pkl`, `generic_model.pkl`, or the like.
        n_identity: how many of its shape directions are identity; the rest are expression.

    Returns:
        The head, without teeth and masks.

    Raises:
        FormatError: it is no pickle of a FLAME model, or asks for something else than arrays.
        HeadError: its arrays do not fit together.
        OSError: it cannot be read.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017; the keys of its public release.
    """
    file = Path(path)
    content = read_pickle(file)
    if not isinstance(content, dict):
        raise FormatError(f"{file}: holds a {type(content).__name__}, expected the dictionary of a FLAME model")
    return _checked_head(file, content, n_identity)


def is_flame_archive(names: Iterable[str]) -> bool:
    """Tell whether names are those of the arrays of a FLAME model, complete or not."""
    return {"v_template", "f"} <= set(names)


def flame_from_arrays(
    arrays: Mapping[str, np.ndarray], pickled: Mapping[str, bytes], path: Path, n_identity: int = N_IDENTITY
) -> HeadModel:
    """Make a checked head of a FLAME model whose dictionary was saved as an `.npz`; see `read_flame_pickle`.

    Args:
        arrays: by FLAME's names.
        pickled: pickles of what the archive holds as objects, of which only the regressor of the joints is looked into, by the same reader
            that runs nothing.
        path: of the archive, for messages and the head's name.
        n_identity: how many of its shape directions are identity.

    Raises:
        FormatError: it is no FLAME model, or its regressor asks for something else than arrays.
        HeadError: its arrays do not fit together.
    """
    content: dict[object, object] = {}
    content.update(arrays.items())
    if "J_regressor" in pickled:
        try:
            content["J_regressor"] = _only_object(parse_pickle(pickled["J_regressor"]))
        except FormatError as error:
            raise FormatError(f"{path}: J_regressor: {error}") from error
    return _checked_head(path, content, n_identity)


def _checked_head(file: Path, content: dict[object, object], n_identity: int) -> HeadModel:
    try:
        head = _head(content, file.stem, n_identity)
        head.validate()
    except (FormatError, HeadError) as error:
        raise type(error)(f"{file}: {error}") from error
    return head


def _only_object(value: object) -> object:
    """Give what an array of one object holds."""
    if not isinstance(value, ArrayRecord) or not isinstance(value.state, tuple) or len(value.state) != 5:
        return value
    held = value.state[4]
    return held[0] if isinstance(held, list) and len(held) == 1 else value


def read_masks(path: str | os.PathLike[str]) -> dict[str, Int[np.ndarray, " m"]]:
    """Read vertex masks by name: `FLAME_masks.pkl`, or the same as `.npz`. Each vertex is listed once, ascending.

    Raises:
        FormatError: the file holds something else.
        OSError: it cannot be read.
    """
    file = Path(path)
    with file.open("rb") as stream:
        is_archive = stream.read(2) == b"PK"
    content = read_npz(file) if is_archive else read_pickle(file)
    if not isinstance(content, dict) or not 0 < len(content) <= MAX_MASKS:
        raise FormatError(f"{file}: holds no vertex masks by name")
    try:
        return {name: _mask(value, f"mask {name[:80]!r}") for name, value in content.items()}
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from error


def _mask(value: object, name: str) -> Int[np.ndarray, " m"]:
    mask = value if isinstance(value, np.ndarray) else _number_array(value, name)
    whole = mask.dtype.kind in "iu" or (mask.dtype.kind == "f" and bool((mask == np.floor(mask)).all()))
    if mask.ndim != 1 or not whole or (mask.size and not (mask.min() >= 0 and mask.max() < 2**31)):
        raise FormatError(f"{name} is not a list of vertex indices")
    return np.unique(mask).astype(np.int32)


def _head(content: dict[object, object], name: str, n_identity: int) -> HeadModel:
    missing = [
        key for key in ("v_template", "f", "shapedirs", "J_regressor", "kintree_table", "weights") if key not in content
    ]
    if missing:
        raise FormatError(f"lacks {', '.join(missing)}, which a FLAME model has")
    v_template = _shaped(content, "v_template", (-1, 3))
    v = len(v_template)
    directions = _shaped(content, "shapedirs", (v, 3, -1))
    if directions.shape[2] < n_identity:
        raise FormatError(
            f"shapedirs has {directions.shape[2]} directions, expected {n_identity} of identity and then those of expression"
        )
    kintree = _number_array(content["kintree_table"], "kintree_table")
    if kintree.ndim != 2 or not kintree.size or kintree.dtype.kind not in "iu":
        raise FormatError(
            f"kintree_table has shape {kintree.shape} of {kintree.dtype}, expected (2, joints) of joint indices"
        )
    parents = np.concatenate([[-1], np.clip(kintree[0, 1:].astype(np.float64), -2, 1 << 30)])
    faces = _number_array(content["f"], "f")
    if faces.dtype.kind not in "iu" or faces.ndim != 2 or (faces.size and int(faces.max()) >= 2**31):
        raise FormatError(f"f has shape {faces.shape} of {faces.dtype}, expected (triangles, 3) of vertex indices")
    posedirs = _shaped(content, "posedirs", (v, 3, -1)) if "posedirs" in content else None
    return HeadModel(
        name=name,
        v_template=as_float32(v_template),
        faces=faces.astype(np.int32),
        shapedirs=as_float32(directions[:, :, :n_identity]),
        exprdirs=as_float32(directions[:, :, n_identity:]),
        J_regressor=as_float32(_dense(content["J_regressor"])),
        weights=as_float32(_number_array(content["weights"], "weights")),
        parents=parents.astype(np.int32),
        posedirs=None if posedirs is None else as_float32(posedirs),
    )


def _shaped(content: dict[object, object], key: str, shape: tuple[int, ...]) -> np.ndarray:
    array = _number_array(content[key], key)
    try:
        return array.reshape(shape)
    except ValueError as error:
        raise FormatError(f"{key} has shape {array.shape}, expected {shape}") from error


def _number_array(value: object, name: str, depth: int = DEPTH) -> np.ndarray:
    """Turn a record into the array that it stands for."""
    if isinstance(value, ArrayRecord):
        return value.array()
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        return value
    if isinstance(value, list) and all(type(item) in {int, float} for item in value):
        try:
            return np.array(value, np.float64)
        except OverflowError as error:
            raise FormatError(f"{name} holds numbers beyond the range of float64") from error
    if not isinstance(value, ChumpyRecord) or depth == 0:
        raise FormatError(f"{name} is a {type(value).__name__}, expected an array of numbers")
    if value.kind == "Ch":
        if "x" not in value.state:
            raise FormatError(f"{name} is a chumpy array without contents")
        return _number_array(value.state["x"], name, depth - 1)
    source = _number_array(value.state.get("a"), name, depth - 1).ravel()
    chosen = _number_array(value.state.get("idxs"), f"idxs of {name}", depth - 1)
    if chosen.dtype.kind not in "iuf" or (chosen.size and not (chosen.min() >= 0 and chosen.max() < len(source))):
        raise FormatError(f"{name} chooses elements that its source of {len(source)} lacks")
    picked = source[chosen.astype(np.int64)]
    shape = value.state.get("preferred_shape")
    if (
        isinstance(shape, tuple)
        and all(type(side) is int and side >= 0 for side in shape)
        and np.prod(shape, dtype=float) == picked.size
    ):
        return picked.reshape(shape)
    return picked


def _dense(value: object) -> np.ndarray:
    """Turn a matrix in compressed sparse columns into a dense one; a dense one stays."""
    if not isinstance(value, SparseRecord):
        return _number_array(value, "J_regressor")
    shape = value.state.get("_shape", value.state.get("shape"))
    rows, columns = shape if isinstance(shape, tuple) and len(shape) == 2 else (None, None)
    if (
        type(rows) is not int
        or type(columns) is not int
        or not (rows > 0 and columns > 0 and rows * columns <= MAX_REGRESSOR)
    ):
        raise FormatError(
            f"J_regressor is a sparse matrix whose shape is not (joints, vertices) of at most {MAX_REGRESSOR} entries"
        )
    data, row_of, starts = (
        _number_array(value.state.get(key), f"J_regressor {key}") for key in ("data", "indices", "indptr")
    )
    kinds = row_of.dtype.kind in "iu" and starts.dtype.kind in "iu" and data.ndim == row_of.ndim == starts.ndim == 1
    if not kinds or len(starts) != columns + 1 or len(data) != len(row_of):
        raise FormatError("J_regressor is no matrix in compressed sparse columns")
    ends = starts.astype(np.int64)
    counts = ends[1:] - ends[:-1]
    if (
        starts[0] != 0
        or starts[-1] != len(data)
        or (counts < 0).any()
        or (len(row_of) and not (row_of.min() >= 0 and row_of.max() < rows))
    ):
        raise FormatError("J_regressor has entries outside its shape")
    dense = np.zeros((rows, columns), data.dtype)
    np.add.at(dense, (row_of, np.repeat(np.arange(columns), counts)), data)
    return dense
