# SPDX-License-Identifier: GPL-3.0-or-later
"""Splats as Blender's data: points with the attributes that Blender's own splats have, and those by which they follow a head."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np

__all__ = ["NATIVE", "make_data", "read_splats"]

# Blender versions that draw splats themselves have this switch on point clouds, and can make point clouds of a given length.
NATIVE = ("resize", "render_as", "spherical_harmonics_degree")
KINDS = {  # of attributes of points: type, and what `foreach_set` calls its numbers
    "scale": ("FLOAT_VECTOR", "vector"),
    "rotation": ("QUATERNION", "value"),
    "color": ("FLOAT_COLOR", "color"),
    "binding": ("INT", "value"),
    "position_local": ("FLOAT_VECTOR", "vector"),
    "scale_local": ("FLOAT_VECTOR", "vector"),
    "rotation_local": ("QUATERNION", "value"),
}


def read_splats(folder: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read what the engine's command `splats` left: arrays and plain values by name; axes are Blender's."""
    told = json.loads((folder / "splats.json").read_text(encoding="utf-8"))
    names = ("position", "sh", *KINDS)
    return {name: np.load(folder / f"{name}.npy", allow_pickle=False) for name in names}, told


def make_data(name: str, arrays: dict[str, np.ndarray], told: dict[str, Any]) -> tuple[bpy.types.ID, bool]:
    """Make points with their attributes.

    Args:
        name: of the data block.
        arrays: as `read_splats` gives them.
        told: likewise.

    Returns:
        The data, and whether Blender draws it as splats itself.

    Raises:
        ValueError: Blender made no attribute of the length that was asked for.
    """
    n = len(arrays["position"])
    cloud = _native_cloud(name, n, told["sh_degree"])
    data = cloud or bpy.data.meshes.new(name)
    if cloud is None:
        data.vertices.add(n)
    _set(data, "position", "FLOAT_VECTOR", "vector", arrays["position"])
    for attribute, (kind, numbers) in KINDS.items():
        _set(data, attribute, kind, numbers, arrays[attribute])
    for k in range(arrays["sh"].shape[1]):
        _set(data, f"sh_{k}", "FLOAT_VECTOR", "vector", arrays["sh"][:, k])
    if cloud is None:
        data.color_attributes.active_color = data.color_attributes["color"]
        data.color_attributes.render_color_index = data.color_attributes.find("color")
    return data, cloud is not None


def _native_cloud(name: str, n: int, sh_degree: int) -> bpy.types.PointCloud | None:
    """Make a point cloud that Blender draws as splats; None where it cannot."""
    described = bpy.types.PointCloud.bl_rna
    if not set(NATIVE) <= {*described.properties.keys(), *described.functions.keys()}:
        return None
    cloud = bpy.data.pointclouds.new(name)
    cloud.resize(n)
    cloud.render_as = "SPLATS"
    cloud.spherical_harmonics_degree = sh_degree
    return cloud


def _set(data: bpy.types.ID, name: str, kind: str, numbers: str, values: np.ndarray) -> None:
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    if attribute is None or len(attribute.data) != len(values):
        raise ValueError(f"Blender made no attribute {name!r} of {len(values)} points")
    wanted = np.int32 if kind == "INT" else np.float32
    attribute.data.foreach_set(numbers, np.ascontiguousarray(values, wanted).ravel())
