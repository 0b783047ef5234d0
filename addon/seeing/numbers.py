# SPDX-License-Identifier: GPL-3.0-or-later
"""Putting the numbers of an opened file on a mesh: attributes, legends and the table of regions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from .. import bridge, sources
from . import painting
from .shown import SORTS, edited

if TYPE_CHECKING:
    from ..opening.scene_folder import Part, SceneFolder, View

__all__ = ["describe", "require_source", "take"]


def take(mesh: bpy.types.Mesh, opened: SceneFolder, source: Path | None = None, compared: Path | None = None) -> None:
    """Replace what a mesh shows by the numbers of another file of the same head, or of the same file anew.

    Args:
        mesh: that something was opened on.
        opened: what the engine says now.
        source: the file, where it is another one.
        compared: the avatar that it is compared with, if any.

    Raises:
        ValueError: the mesh has other triangles than the file, or is in Edit Mode.
    """
    shown = mesh.sacha
    if mesh.is_editmode:
        raise ValueError(f"{mesh.name} is in Edit Mode: leave it, and do this again")
    if complaint := edited(mesh):
        raise ValueError(f"{complaint}; open the file anew instead")
    if len(opened.faces) != shown.n_faces or (shown.head and opened.head != shown.head):
        raise ValueError(
            f"{opened.name} is of head {opened.head!r} with {len(opened.faces):,} triangles, {mesh.name} of {shown.head!r} with "
            f"{shown.n_faces:,}: open it as a mesh of its own"
        )
    describe(mesh, opened, Path(shown.source) if source is None else source, compared)


def require_source(mesh: bpy.types.Mesh, source: Path) -> None:
    """Check that a mesh still shows the file that a job has read: undo may have brought an earlier one back.

    Raises:
        ValueError: it shows another one.
    """
    now = sources.full_path(mesh.sacha.source)
    if now != source:
        raise ValueError(f"{mesh.name} shows {now.name} now, no longer {source.name}: do this again")


def describe(mesh: bpy.types.Mesh, opened: SceneFolder, source: Path, compared: Path | None = None) -> None:
    """Keep with a mesh all numbers of its triangles and regions, what they mean and where they come from, and show the view shown before.

    Args:
        mesh: of the opened triangles, in their order.
        opened: what the engine says.
        source: the file that it was opened from.
        compared: the avatar that it is compared with, if any.

    Raises:
        ValueError: an attribute of the user's own has the name of a view.
    """
    shown = mesh.sacha
    before = shown.view
    _forget(mesh, {view.name for view in opened.views})
    for view in opened.views:
        bridge.face_numbers(mesh, view.name, view.values)
        bridge.face_numbers(mesh, painting.level_attribute(view.name), view.levels)
    palettes = opened.parts["palettes"].arrays if "palettes" in opened.parts else {}
    mesh[painting.PALETTES] = {name: rows.ravel().tolist() for name, rows in palettes.items() if len(rows)}
    shown.source, shown.kind, shown.head = str(source), opened.kind, opened.head
    shown.compared = "" if compared is None else str(compared)
    shown.n_faces = len(opened.faces)
    _replace(shown.facts, opened.facts)
    _replace(shown.absent, [*opened.notes, *opened.absent])
    shown.views.clear()
    for view in opened.views:
        _add_view(shown.views.add(), view, palettes[view.palette])
    _fill_table(shown, opened.parts.get("regions"), palettes.get("region"))
    names = [view.name.upper() for view in opened.views]
    if names:
        shown.view = before if before in names else names[0]
        painting.paint(mesh)


def _forget(mesh: bpy.types.Mesh, wanted: set[str]) -> None:
    """Remove the attributes of views that there were and will not be."""
    for name in [view.name for view in mesh.sacha.views if view.name not in wanted]:
        for attribute in (name, painting.level_attribute(name)):
            if attribute in mesh.attributes:
                mesh.attributes.remove(mesh.attributes[attribute])


def _replace(lines: bpy.types.bpy_prop_collection, texts: list[str]) -> None:
    lines.clear()
    for text in texts:
        lines.add().name = text


def _add_view(kept: bpy.types.PropertyGroup, view: View, palette: np.ndarray) -> None:
    """Keep what a view's colours mean."""
    kept.name, kept.label, kept.unit = view.name, view.label, view.unit
    kept.about, kept.palette = view.about, view.palette
    for told in view.legend:
        line = kept.legend.add()
        line.name, line.kept = told["label"], palette[told["level"], :3]
    for told in view.by_region:
        number = kept.by_region.add()
        number.name, number.level, number.kept = told["text"], told["level"], palette[told["level"], :3]
        number.known = told["value"] is not None
        number.value = told["value"] if number.known else 0.0


def _fill_table(shown: bpy.types.PropertyGroup, told: Part | None, colours: np.ndarray | None) -> None:
    """Fill the table of regions, with the columns that the engine gave."""
    shown.regions.clear()
    shown.scheme = "" if told is None else told.values["scheme"]
    shown.before_name = "" if told is None else told.values["before_name"]
    arrays = {} if told is None else told.arrays
    columns = [name for name, _, _ in SORTS if name == "place" or name in arrays]
    shown.columns = " ".join(columns) if told is not None else ""
    if shown.sort_by not in columns:
        shown.sort_by, shown.sort_down = "place", False
    for place, name in enumerate([] if told is None else told.values["names"]):
        row = shown.regions.add()
        row.name, row.place, row.kept = name, place, colours[place, :3]
        for column, numbers in arrays.items():
            setattr(row, column, numbers[place].item())
