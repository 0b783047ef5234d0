"""Weights of blend shapes over time, named as ARKit names them."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.npz import as_float32, read_npz

__all__ = ["arkit_from_arrays", "read_arkit_motion"]

USUAL_FRAME_RATE = 30.0  # ARKit's own, half its camera's


def read_arkit_motion(path: str | os.PathLike[str], head: HeadModel | None = None) -> Motion:
    """Read blend-shape weights as a motion whose expression they are.

    Args:
        path: an `.npz` with `weights` (t, e), and optionally `names` (e,) and `time_s` (t,).
        head: whose expressions they drive. Where both have names, weights are put in the head's order.

    Returns:
        The motion, without identity, pose, or translation.

    Raises:
        FormatError: the file is damaged or its arrays do not fit together.
        HeadError: the head lacks a blend shape that the motion uses.
        OSError: the file cannot be read.
    """
    try:
        return arkit_from_arrays(read_npz(path), head)
    except FormatError as error:
        raise error if str(path) in str(error) else FormatError(f"{path}: {error}") from error
    except HeadError as error:
        raise HeadError(f"{path}: {error}") from error


def arkit_from_arrays(arrays: dict[str, np.ndarray], head: HeadModel | None = None) -> Motion:
    """Make a checked motion of the arrays of such a file; see `read_arkit_motion`."""
    weights = arrays.get("weights", np.zeros(0))
    if weights.ndim != 2 or weights.dtype.kind not in "fiu":
        raise FormatError(
            f"weights have shape {weights.shape} of {weights.dtype}, expected (frames, blend shapes) of real numbers"
        )
    weights = as_float32(weights)
    names = tuple(str(name) for name in arrays["names"].reshape(-1)) if "names" in arrays else ()
    if names and (len(names) != weights.shape[1] or len(set(names)) != len(names)):
        raise FormatError(f"{len(set(names))} different names for {weights.shape[1]} blend shapes, expected one each")
    if head is not None:
        weights = _in_order_of(head, weights, names)
    rest = Motion.rest(0, weights.shape[1], len(weights), _frame_rate(arrays.get("time_s"), len(weights)))
    motion = replace(rest, expression=weights)
    motion.validate()
    return motion


def _in_order_of(
    head: HeadModel, weights: Float[np.ndarray, "t e"], names: tuple[str, ...]
) -> Float[np.ndarray, "t k"]:
    n = head.exprdirs.shape[2]
    if not (names and head.expression_names):
        if weights.shape[1] != n:
            raise HeadError(
                f"the motion has {weights.shape[1]} blend shapes and head {head.name!r} has {n}, and not both have names for them"
            )
        return weights
    ordered = np.zeros((len(weights), n), np.float32)
    for column, name in enumerate(names):
        if name in head.expression_names:
            ordered[:, head.expression_names.index(name)] = weights[:, column]
        elif weights[:, column].any():
            raise HeadError(f"head {head.name!r} has no blend shape {name!r}, which the motion uses")
    return ordered


def _frame_rate(times_s: np.ndarray | None, n_frames: int) -> float:
    if times_s is None or n_frames < 2:
        return USUAL_FRAME_RATE
    if times_s.shape != (n_frames,) or times_s.dtype.kind not in "fiu":
        raise FormatError(
            f"time_s has shape {times_s.shape} of {times_s.dtype}, expected one real number for each of {n_frames} frames"
        )
    duration_s = float(times_s[-1]) - float(times_s[0])
    if not duration_s > 0:
        raise FormatError(
            f"time_s runs from {float(times_s[0]):.6g} to {float(times_s[-1]):.6g}, expected it to ascend"
        )
    return round((n_frames - 1) / duration_s, 3)  # float32 times are no better than that
