"""A head's mesh as a scene: that of the head which is named, or of the one used before whose triangles it has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sacha_core.cli.common import HeadSource
from sacha_core.cli.showing import regions_of
from sacha_core.cli.sources import named_head, open_motion, with_coordinates
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import attach_masks
from sacha_core.flame.shelf import heads_with
from sacha_core.interchange.head_mesh import HeadMesh, read_head_mesh
from sacha_core.scene.contents import Scene, scene_of_mesh

__all__ = ["open_mesh_scene"]


def open_mesh_scene(path: Path, source: HeadSource, motion: Path | None, scheme: Path | None) -> Scene:
    """Read a mesh and show it, as that of a head where one is known.

    Args:
        path: of the mesh.
        source: the head whose triangles it has; by default one that was used before, if just one has them.
        motion: file of a motion that it shall have.
        scheme: file of regions.

    Raises:
        SachaError: a file is damaged, or the mesh has not the triangles of the head that is named.
        OSError: a file cannot be read.
    """
    mesh, named = read_head_mesh(path), named_head(source)
    head, notes = _used_before(mesh, source) if named is None else (named, [])
    if head is None:
        scene = scene_of_mesh(path.stem, mesh, None)
    else:
        moved = None if motion is None else open_motion(motion, head)
        scene = scene_of_mesh(path.stem, mesh, with_coordinates(head), moved, regions_of(scheme, head))
    return replace(scene, notes=[*scene.notes, *notes])


def _used_before(mesh: HeadMesh, source: HeadSource) -> tuple[HeadModel | None, list[str]]:
    """Find the head of a mesh among those used before, and tell which."""
    known = heads_with(mesh.faces)
    if len(known) != 1:
        names = ", ".join(head.name for head in known)
        return None, [f"Its triangles are those of {len(known)} heads used before: {names}"] if known else []
    head = known[0] if source.masks is None else attach_masks(known[0], source.masks)
    return head, [f"Taken for a mesh of head {head.name!r}, which was used before and has its triangles"]
