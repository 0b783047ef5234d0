# SPDX-License-Identifier: GPL-3.0-or-later
"""What the engine's command `scene` leaves in a folder: a head as arrays, and a legend. Knows nothing of Blender."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Part", "SceneFolder", "View", "read_scene_folder"]


@dataclass(frozen=True)
class View:
    """One number a triangle, its colours, and what they mean.

    Args:
        name: of the attribute: "region", "count" ...
        values: (f,) int32 or float32; NaN where nothing is known.
        levels: (f,) int32, the colour of each triangle as a row of the palette.
        label: what people call it.
        unit: of the values, or empty.
        about: a sentence that says what it is.
        palette: name of an array of the part `palettes`.
        legend: lines of the legend, top to bottom: `label` and `level`.
        by_region: for each region `value` (None where not known), `level` and `text`; empty where regions are not known.
    """

    name: str
    values: np.ndarray
    levels: np.ndarray
    label: str
    unit: str
    about: str
    palette: str
    legend: list[dict[str, Any]]
    by_region: list[dict[str, Any]]


@dataclass(frozen=True)
class Part:
    """What a scene may have besides its mesh and views: a rig, an animation, cameras, splats.

    Args:
        arrays: by name.
        values: plain ones (numbers, texts, lists), by name.
    """

    arrays: dict[str, np.ndarray]
    values: dict[str, Any]


@dataclass(frozen=True)
class SceneFolder:
    """One head as the engine sees it; axes y up, metres.

    Args:
        name: what to call it.
        kind: "avatar", "head" or "mesh".
        vertices: (v, 3) float32.
        faces: (f, 3) int32.
        uv: (f, 3, 2) float32 texture coordinates at corners, or None.
        views: what can be shown on it; none where its regions are not known.
        facts: lines that say what it is (number of Gaussians, bytes, frames).
        notes: what the user should know, one line each.
        absent: which further views there could be, and how to get them, one line each.
        head: where the engine found its head model, or its name.
        parts: what else there is, by name; each is described where the engine makes it, `sacha_core/scene/NAME.py`.
    """

    name: str
    kind: str
    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None
    views: list[View]
    facts: list[str]
    notes: list[str]
    absent: list[str]
    head: str
    parts: dict[str, Part]


def read_scene_folder(folder: Path) -> SceneFolder:
    """Read what the engine left in `folder`."""
    told = json.loads((folder / "scene.json").read_text(encoding="utf-8"))

    def array(name: str) -> np.ndarray:
        return np.load(folder / f"{name}.npy", allow_pickle=False)

    views = [View(name, array(name), array(f"{name}_level"), **said) for name, said in told["views"].items()]
    parts = {
        name: Part({field: array(f"{name}_{field}") for field in part["arrays"]}, part["values"])
        for name, part in told["parts"].items()
    }
    return SceneFolder(
        told["name"],
        told["kind"],
        array("vertices"),
        array("faces"),
        array("uv") if (folder / "uv.npy").exists() else None,
        views,
        told["facts"],
        told["notes"],
        told["absent"],
        told["head"],
        parts,
    )
