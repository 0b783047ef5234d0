# SPDX-License-Identifier: GPL-3.0-or-later
"""A data block that a job is about, to be found again when the job ends.

The user may have renamed or removed it meanwhile, and undo may have made another of it: neither its name nor a reference says which it is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy

from .features import session_number

__all__ = ["Remembered", "remember"]

COLLECTIONS = {"Mesh": "meshes", "Object": "objects", "Scene": "scenes"}  # class -> where in `bpy.data`


@dataclass(frozen=True)
class Remembered:
    """One data block.

    Args:
        kind: the name of its class.
        name: what it was called when it was remembered.
        number: Blender's number of it, its own while Blender runs, after undo too; None where Blender tells none: then the name has to do.
    """

    kind: str
    name: str
    number: int | None

    def find(self) -> bpy.types.ID | None:
        """Give it as it is now; None where it is gone."""
        everything: Iterable[bpy.types.ID] = getattr(bpy.data, COLLECTIONS[self.kind])
        same = (one for one in everything if self._is(one))
        return next(same, None)

    def require(self, otherwise: str) -> bpy.types.ID:
        """Give it as it is now.

        Args:
            otherwise: what it means for the user if it is gone.

        Raises:
            ValueError: it is gone.
        """
        found = self.find()
        if found is None:
            raise ValueError(f"{self.name} is gone: {otherwise}")
        return found

    def _is(self, one: bpy.types.ID) -> bool:
        return one.name == self.name if self.number is None else session_number(one) == self.number


def remember(block: bpy.types.Mesh | bpy.types.Object | bpy.types.Scene) -> Remembered:
    """Remember a data block."""
    return Remembered(type(block).__name__, block.name, session_number(block))
