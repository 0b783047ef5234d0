"""A motion from whatever file holds one."""

from __future__ import annotations

import os

from sacha_core.avatar.motion import Motion
from sacha_core.errors import FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.arkit_motion import arkit_from_arrays
from sacha_core.interchange.gaussian_avatars import DYNAMIC_OFFSET, motion_from_arrays
from sacha_core.npz import read_npz

__all__ = ["read_motion"]

HEADS_OWN = {"v_template", "verts"}  # arrays that heads and rigs have, and no motion


def read_motion(path: str | os.PathLike[str], head: HeadModel | None = None) -> Motion:
    """Read FLAME parameters in GaussianAvatars' layout, or weights of blend shapes; the arrays' names tell which.

    Args:
        path: an `.npz` file.
        head: that shall be moved, where known: blend shapes are then put in its order.

    Raises:
        FormatError: the file holds neither, or is damaged.
        HeadError: the head lacks a blend shape that the motion uses.
        OSError: the file cannot be read.
    """
    arrays = read_npz(path, skip=(DYNAMIC_OFFSET,))
    if HEADS_OWN & arrays.keys():  # whose skinning weights are not those of blend shapes
        raise FormatError(f"{path} is a head, expected a motion: 'expr' (FLAME parameters) or 'weights' (blend shapes)")
    try:
        if "weights" in arrays:
            return arkit_from_arrays(arrays, head)
        if "expr" in arrays:
            return motion_from_arrays(arrays)
    except (FormatError, HeadError) as error:
        raise type(error)(f"{path}: {error}") from error
    held = ", ".join(list(arrays)[:8]) or "nothing"
    raise FormatError(
        f"{path} holds no motion: expected 'expr' (FLAME parameters) or 'weights' (blend shapes), found {held}"
    )
