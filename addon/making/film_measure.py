# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of a film before it has pictures: the parameters of each frame, the cameras, and where the posed head is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import bridge
from ..looking.camera import camera_file
from ..opening import controls

__all__ = ["measure"]

N_CHECKED = 3  # timesteps whose posed head the engine holds against the parameters


def measure(
    scene: bpy.types.Scene, told: dict[str, Any], footage: Path, say: Callable[[dict[str, Any]], None]
) -> list[dict[str, Any]]:
    """Go through all frames once, and write what is known without pictures: parameters, cameras, and how the head is posed.

    Args:
        scene: what is filmed.
        told: see `film_head.film_settings`.
        footage: the folder that it goes to.
        say: told about progress.

    Returns:
        One entry for each picture, in the order of time.

    Raises:
        ValueError: the head's controls or a camera cannot be said in the engine's terms.
    """
    head, frames = scene.objects[told["head"]], told["frames"]
    checked = sorted({round(i * (len(frames) - 1) / (N_CHECKED - 1)) for i in range(N_CHECKED)})
    rows, posed, views = [], [], []
    for timestep, frame in enumerate(frames):
        scene.frame_set(frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        rows.append(controls.read(head, depsgraph))
        if timestep in checked:
            posed.append(evaluated_vertices(head))
            depsgraph = bpy.context.evaluated_depsgraph_get()
        for index, name in enumerate(told["cameras"]):
            seen = camera_file(scene.objects[name], depsgraph, told["width"], told["height"])
            places = {"timestep": timestep, "camera_index": index, "file": f"{timestep:05d}_{index:02d}.png"}
            views.append({**places, **{key: seen[key] for key in ("width", "height", "K", "world_to_camera")}})
        say({"stage": "measure", "done": timestep + 1, "total": len(frames)})
    write_parameters(footage / "flame_param.npz", rows, told["frame_rate"])
    np.save(footage / "posed.npy", np.stack(posed))
    np.save(footage / "unposed.npy", controls.neutral(head))  # sculpted or not
    origin = {
        key: told[key]
        for key in ("renderer", "samples", "width", "height", "frames", "scene", "head", "cameras", "kept")
    }
    facts = {"subject": told["subject"], "take": told["take"], "origin": {"blender": bpy.app.version_string, **origin}}
    (footage / "footage.json").write_text(json.dumps({**facts, "checked": checked, "views": views}), encoding="utf-8")
    return views


def write_parameters(path: Path, rows: list[dict[str, np.ndarray]], frame_rate: float) -> None:
    """Write FLAME parameters of all timesteps under GaussianAvatars' names."""
    keys = {
        "expression": "expr",
        "rotation": "rotation",
        "neck": "neck_pose",
        "jaw": "jaw_pose",
        "eyes": "eyes_pose",
        "translation": "translation",
    }
    arrays = {key: np.stack([row[name] for row in rows]).astype(np.float32) for name, key in keys.items()}
    np.savez(path, shape=rows[0]["shape"], frame_rate=np.array(frame_rate), **arrays)


def positions(points: bpy.types.bpy_prop_collection) -> np.ndarray:
    """Give (v, 3) positions of a mesh's vertices or a shape key's points."""
    values = np.empty(3 * len(points), np.float32)
    points.foreach_get("co", values)
    return values.reshape(-1, 3)


def evaluated_vertices(head: bpy.types.Object) -> np.ndarray:
    """Give (v, 3) vertices of a head as its controls pose it, in the engine's world; what only smooths or refines it is left out."""
    others = [modifier for modifier in head.modifiers if modifier.type != "ARMATURE" and modifier.show_viewport]
    for modifier in others:
        modifier.show_viewport = False
    evaluated = head.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found, world = positions(evaluated.data.vertices), np.array(evaluated.matrix_world)
    for modifier in others:
        modifier.show_viewport = True
    return bridge.to_engine(found @ world[:3, :3].T.astype(np.float32) + world[:3, 3].astype(np.float32))
