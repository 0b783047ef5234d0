"""A scene as a folder of arrays.

The folder holds `vertices.npy` (v, 3) float32, metres, y up; `faces.npy` (f, 3) int32; `uv.npy` (f, 3, 2) float32 at the corners where
the head has texture coordinates; for each view NAME its numbers `NAME.npy` (f,) int32 and colours `NAME_colour.npy` (f, 4) float32, linear
RGBA; for each part PART of the scene (a rig, cameras ...: a field of `Scene` that is a dataclass) its arrays `PART_FIELD.npy`; and
`scene.json`, written last: name, kind, head, facts and notes (lines for people), the views with their legends, and the parts, each with the
names of its `arrays` and its plain `values`.
"""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.files import write_aside
from sacha_core.scene.contents import Scene
from sacha_core.scene.part import Part, part_of

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
        arrays |= {name: view.values, f"{name}_colour": view.colours}
    parts = _parts(scene)
    for name, part in parts.items():
        arrays |= {f"{name}_{field}": array for field, array in part.arrays.items()}
    for name, array in arrays.items():
        if array is not None:
            with write_aside(folder / f"{name}.npy") as aside:
                np.save(aside, array, allow_pickle=False)
    told: dict[str, Any] = {name: getattr(scene, name) for name in ("name", "kind", "head", "facts", "notes")}
    told["views"] = {name: view.legend for name, view in scene.views.items()}
    told["parts"] = {name: {"arrays": sorted(part.arrays), "values": part.values} for name, part in parts.items()}
    with write_aside(folder / "scene.json") as aside:
        aside.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def _parts(scene: Scene) -> dict[str, Part]:
    """Give the parts that the scene has, by name."""
    given = {field.name: getattr(scene, field.name) for field in fields(scene)}
    return {name: part_of(value) for name, value in given.items() if is_dataclass(value)}
