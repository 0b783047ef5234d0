# SPDX-License-Identifier: GPL-3.0-or-later
"""A head divided into regions by the user: as face sets or material slots say, or as it is shown now."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Color

from .. import bridge

__all__ = ["Division", "by_face_sets", "by_materials", "shown_division", "write_division"]

FACE_SETS = ".sculpt_face_set"  # Blender's own name of the attribute
FORBIDDEN = "=:"  # stand between a region's name and its numbers on the engine's command line
VERSION = 1  # of the engine's scheme files (sacha_core/regions/scheme_file.py)


@dataclass(frozen=True)
class Division:
    """Regions of one's own.

    Args:
        name: of the division.
        regions: name of each region.
        labels: (f,) region of each triangle.
        colours: (r, 3) uint8 sRGB, or None for the engine's.
    """

    name: str
    regions: list[str]
    labels: np.ndarray
    colours: np.ndarray | None = None


def by_face_sets(mesh: bpy.types.Mesh) -> Division:
    """Make a region of each face set.

    Raises:
        ValueError: the mesh has none.
    """
    if FACE_SETS not in mesh.attributes:
        raise ValueError(f"{mesh.name} has no face sets: make some in Sculpt Mode, and leave it")
    sets, labels = np.unique(bridge.read_face_integers(mesh, FACE_SETS), return_inverse=True)
    return Division("face sets", [f"set {number}" for number in sets.tolist()], labels)


def by_materials(mesh: bpy.types.Mesh) -> Division:
    """Make a region of each material slot that some triangle has, in the material's viewport colour.

    Raises:
        ValueError: the mesh has no materials.
    """
    if not len(mesh.materials):
        raise ValueError(f"{mesh.name} has no materials: give its faces some, one for each region")
    slots = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", slots)
    used, labels = np.unique(np.minimum(slots, len(mesh.materials) - 1), return_inverse=True)
    materials = [mesh.materials[slot] for slot in used.tolist()]
    names = [
        material.name if material else f"slot {slot}" for slot, material in zip(used.tolist(), materials, strict=True)
    ]
    colours = [_srgb(material.diffuse_color[:3]) if material else (216, 216, 216) for material in materials]
    return Division("materials", _told_apart(names), labels, np.array(colours, np.uint8))


def shown_division(mesh: bpy.types.Mesh) -> Division:
    """Give the regions that a mesh shows.

    Raises:
        ValueError: it shows none, or the attribute that says which triangle is whose is gone.
    """
    if not len(mesh.sacha.regions):
        raise ValueError(
            f"The regions of {mesh.name} are not known: name its head's masks and open it again, or make some of your own"
        )
    if "region" not in mesh.attributes:
        raise ValueError(f"The triangles of {mesh.name} have lost their attribute 'region': open the file anew")
    rows = sorted(mesh.sacha.regions, key=lambda row: row.place)
    colours = np.array([_srgb(row.colour) for row in rows], np.uint8)
    labels = bridge.read_face_integers(mesh, "region")
    return Division(mesh.sacha.scheme, [row.name for row in rows], labels, colours)


def write_division(path: Path, division: Division) -> Path:
    """Write a scheme file for the engine; give its path."""
    arrays = {"version": np.array(VERSION, np.int32), "name": np.array(division.name)}
    arrays |= {"regions": np.array(division.regions), "labels": np.asarray(division.labels, np.int32)}
    if division.colours is not None:
        arrays["colours"] = division.colours
    np.savez(path, **arrays)
    return path


def _srgb(linear: tuple[float, float, float]) -> tuple[int, int, int]:
    """Give the bytes of a colour as screens have it."""
    red, green, blue = Color(linear).from_scene_linear_to_srgb()
    return tuple(round(255 * min(max(part, 0.0), 1.0)) for part in (red, green, blue))


def _told_apart(names: list[str]) -> list[str]:
    """Give each region a name of its own that the engine's command line can have."""
    found: list[str] = []
    for name in names:
        plain = "".join("_" if letter in FORBIDDEN else letter for letter in name).strip(" -") or "region"
        same, number = plain, 2
        while same in found:
            same, number = f"{plain} {number}", number + 1
        found.append(same)
    return found
