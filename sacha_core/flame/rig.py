"""Generic rigs: a mesh with blend shapes and no joints."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Int, Num

from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.head_file import MASK_PREFIX, head_from_arrays
from sacha_core.flame.model import HeadModel
from sacha_core.npz import read_npz

__all__ = ["is_rig_archive", "read_rig", "rig_from_arrays"]

LOWEST = 0.1  # share of its height at the bottom that counts as a rig's neck where no mask tells


def read_rig(path: str | os.PathLike[str]) -> HeadModel:
    """Read a rig.

    Args:
        path: an `.npz` with `verts` (v, 3), `faces` (f, 3), and optionally blend shapes `arkit_deltas` (e, v, 3) with `arkit_names` (e,),
            `uv` with `uv_faces`, and vertex masks `mask_NAME`. Other arrays are ignored.

    Returns:
        The rig as a head: blend shapes as expressions, no identity, one root joint at the centre of the neck, or of its lowest tenth.

    Raises:
        FormatError: the file is damaged or lacks an array.
        HeadError: the arrays do not fit together.
        OSError: it cannot be read.
    """
    file = Path(path)
    try:
        return rig_from_arrays(read_npz(file), file.stem)
    except HeadError as error:
        raise HeadError(f"{file}: {error}") from error


def is_rig_archive(arrays: Mapping[str, np.ndarray]) -> bool:
    """Tell whether arrays have the names of a rig's."""
    return "verts" in arrays and "faces" in arrays


def rig_from_arrays(arrays: Mapping[str, np.ndarray], name: str) -> HeadModel:
    """Make a checked head of a rig's arrays; see `read_rig`."""
    vertices = arrays["verts"]
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise FormatError(
            f"verts of rig {name!r} has shape {vertices.shape} of {vertices.dtype}, expected (vertices, 3) of real numbers"
        )
    v = len(vertices)
    deltas = arrays.get("arkit_deltas", np.zeros((0, v, 3), np.float32))
    if deltas.ndim != 3 or deltas.shape[1:] != (v, 3):
        raise FormatError(f"arkit_deltas of rig {name!r} has shape {deltas.shape}, expected (blend shapes, {v}, 3)")
    made = {
        "v_template": vertices,
        "faces": arrays["faces"],
        "shapedirs": np.zeros((v, 3, 0), np.float32),
        "exprdirs": deltas.transpose(1, 2, 0),
        "J_regressor": np.zeros((1, v), np.float32),
        "weights": np.ones((v, 1), np.float32),
        "parents": np.array([-1], np.int32),
    }
    for ours, theirs in (("expression_names", "arkit_names"), ("uv", "uv"), ("uv_faces", "uv_faces")):
        if theirs in arrays:
            made[ours] = arrays[theirs]
    made |= {key: array for key, array in arrays.items() if key.startswith(MASK_PREFIX)}
    neck = _neck(vertices, arrays.get(f"{MASK_PREFIX}neck"))
    made["J_regressor"][0, neck] = 1 / max(len(neck), 1)
    return head_from_arrays(made, name)


def _neck(vertices: Num[np.ndarray, "v 3"], mask: np.ndarray | None) -> Int[np.ndarray, " m"]:
    """Vertices whose centre is the root joint."""
    if mask is not None and mask.size and mask.dtype.kind in "iu" and mask.min() >= 0 and mask.max() < len(vertices):
        return np.unique(mask).astype(np.int64)
    height = vertices[:, 1].astype(np.float64)
    if not len(height) or not np.isfinite(height).all():
        return np.zeros(0, np.int64)  # the head's check names what is wrong
    lowest, highest = height.min(), height.max()
    return np.flatnonzero(height <= lowest + LOWEST * (highest - lowest))
