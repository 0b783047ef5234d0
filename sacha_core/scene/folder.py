"""A scene as a folder of arrays.

The folder holds `vertices.npy` (v, 3) float32, metres, y up; `faces.npy` (f, 3) int32; `uv.npy` (f, 3, 2) float32 at the corners where
the head has texture coordinates; for each view NAME its numbers `NAME.npy` (f,) int32 and colours `NAME_colour.npy` (f, 4) float32, linear
RGBA; and `scene.json`, written last: name, kind, head, facts and notes (lines for people), and the views with their legends.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from sacha_core.files import write_aside
from sacha_core.scene.contents import Scene

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
    for name, array in arrays.items():
        if array is not None:
            with write_aside(folder / f"{name}.npy") as aside:
                np.save(aside, array, allow_pickle=False)
    told = {name: getattr(scene, name) for name in ("name", "kind", "head", "facts", "notes")}
    told["views"] = {name: view.legend for name, view in scene.views.items()}
    with write_aside(folder / "scene.json") as aside:
        aside.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
