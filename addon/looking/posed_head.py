# SPDX-License-Identifier: GPL-3.0-or-later
"""The head that is looked at, and its vertices as they are now, whatever poses them."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from .. import bridge
from ..active import NO_AVATAR, avatar_of

__all__ = ["chosen_head", "save_vertices", "source_of", "splats_on"]


def chosen_head(context: bpy.types.Context) -> bpy.types.Object | None:
    """Give the avatar's head that is active, or whose splats are; None where neither is."""
    active = context.object
    if active is not None and active.sacha_splats.head is not None:
        active = active.sacha_splats.head
    return avatar_of(active)


def source_of(context: bpy.types.Context) -> tuple[bpy.types.Object, Path]:
    """Give the head that is looked at and the file that its avatar was opened from.

    Raises:
        ValueError: no avatar is active.
    """
    head = chosen_head(context)
    if head is None:
        raise ValueError(NO_AVATAR)
    return head, Path(bpy.path.abspath(head.data.sacha.source)).absolute()


def splats_on(head: bpy.types.Object) -> bpy.types.Object | None:
    """Give the object of a head's splats, where there is one in a scene."""
    found = (other for other in bpy.data.objects if other.sacha_splats.head == head and other.users_scene)
    return next(found, None)


def save_vertices(head: bpy.types.Object, depsgraph: bpy.types.Depsgraph, path: Path) -> None:
    """Write the vertices of a head in its present pose, in its own space, as the engine reads them.

    Raises:
        ValueError: its mesh, or what its modifiers make of it, has other vertices or triangles than the mesh that was opened.
        OSError: the file cannot be written.
    """
    posed = head.evaluated_get(depsgraph).data
    if (len(posed.vertices), len(posed.polygons)) != (len(head.data.vertices), len(head.data.polygons)):
        raise ValueError(
            f"The modifiers of {head.name!r} change its topology ({len(posed.polygons)} faces instead of"
            f" {len(head.data.polygons)}): switch off those that do"
        )
    opened_faces = getattr(head.data.sacha, "n_faces", 0)
    if opened_faces and opened_faces != len(head.data.polygons):
        raise ValueError(
            f"The mesh of {head.name!r} was edited: it has {len(head.data.polygons)} faces, and had {opened_faces}"
            " when it was opened; open the avatar again"
        )
    vertices = np.empty(3 * len(posed.vertices), np.float32)
    posed.vertices.foreach_get("co", vertices)
    np.save(path, bridge.to_engine(vertices.reshape(-1, 3)), allow_pickle=False)
