"""A scene as a folder of arrays.

The folder holds `vertices.npy` (v, 3) float32, metres, y up; `faces.npy` (f, 3) int32; `uv.npy` (f, 3, 2) float32 at the corners where
the head has texture coordinates; for each view NAME its numbers `NAME.npy` (f,) int32 or float32 (NaN where not known) and the colour of
each, `NAME_level.npy` (f,) int32, a row of the view's palette; for each part PART of the scene (palettes, the table of regions, a rig ...:
a field of `Scene` that is a dataclass) its arrays `PART_FIELD.npy`; and `scene.json`, written last: name, kind, head, facts, notes and
absent (lines for people), the views with their legends and what they say of regions, and the parts, each with the names of its `arrays`
and its plain `values`.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.files import write_aside
from sacha_core.scene.contents import Scene
from sacha_core.scene.part import Part, part_of
from sacha_core.scene.view import View

__all__ = ["write_scene"]


def write_scene(scene: Scene, folder: Path) -> None:
    """Write the arrays, and last `scene.json`: a folder that has it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    arrays: dict[str, np.ndarray | None] = {
        "vertices": scene.vertices.astype(np.float32, copy=False),
        "faces": scene.faces.astype(np.int32, copy=False),
        "uv": scene.uv,
    }
    for name, view in scene.views.items():
        arrays |= {name: view.values, f"{name}_level": view.levels}
    parts = _parts(scene)
    for name, part in parts.items():
        arrays |= {f"{name}_{field}": array for field, array in part.arrays.items()}
    for name, array in arrays.items():
        if array is not None:
            with write_aside(folder / f"{name}.npy") as aside:
                np.save(aside, array, allow_pickle=False)
    told: dict[str, Any] = {name: getattr(scene, name) for name in ("name", "kind", "head", "facts", "notes", "absent")}
    told["views"] = {name: _told(view) for name, view in scene.views.items()}
    told["parts"] = {name: {"arrays": sorted(part.arrays), "values": part.values} for name, part in parts.items()}
    with write_aside(folder / "scene.json") as aside:
        aside.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def _told(view: View) -> dict[str, Any]:
    """Give what a view says in words; what is not a number is null in JSON."""
    by_region = [
        asdict(number) | {"value": number.value if math.isfinite(number.value) else None} for number in view.by_region
    ]
    plain = {name: getattr(view, name) for name in ("label", "unit", "about", "palette", "legend")}
    return plain | {"by_region": by_region}


def _parts(scene: Scene) -> dict[str, Part]:
    """Give the parts that the scene has, by name."""
    given = {field.name: getattr(scene, field.name) for field in fields(scene)}
    return {name: part_of(value) for name, value in given.items() if is_dataclass(value)}
