# SPDX-License-Identifier: GPL-3.0-or-later
"""The cameras of a capture as cameras of the scene, so exact that a render covers the capture's picture pixel by pixel."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from .. import bridge
from .scene_folder import Part

__all__ = ["add_cameras"]

SENSOR_MM = 36.0  # any width does: only its ratio to the focal length shows
LOOKS_DOWN_Z = np.diag((1.0, -1.0, -1.0))  # Blender's cameras look along -z with y up, the engine's along z with y down
SQUARE = 1e-6  # how far the sides of a square pixel may differ


def add_cameras(context: bpy.types.Context, name: str, cameras: Part) -> list[str]:
    """Put cameras into a collection of their own; a scene without a camera takes the first, and its size of image.

    Returns:
        Notes for the user.
    """
    collection = bpy.data.collections.new(f"{name} cameras")
    context.scene.collection.children.link(collection)
    rows = zip(
        cameras.values["names"],
        cameras.arrays["sizes"].tolist(),
        cameras.arrays["intrinsics"].tolist(),
        cameras.arrays["world_to_camera"],
        strict=True,
    )
    made = [_add_camera(collection, *row) for row in rows]
    if not made or context.scene.camera is not None:
        return []
    context.scene.camera = made[0]
    (width, height), (fx, fy, _, _) = cameras.arrays["sizes"][0].tolist(), cameras.arrays["intrinsics"][0].tolist()
    render = context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, fy / fx), max(1.0, fx / fy)
    ratios = cameras.arrays["intrinsics"][:, 0] / cameras.arrays["intrinsics"][:, 1]
    alike = (cameras.arrays["sizes"] == (width, height)).all(axis=1) & (np.abs(ratios - fx / fy) <= SQUARE)
    if alike.all():
        return []
    other = cameras.values["names"][int(np.argmin(alike))]
    return [f"Pictures of {other} have another size than those of {made[0].name}, which the scene has now"]


def _add_camera(
    collection: bpy.types.Collection,
    name: str,
    size: list[int],
    intrinsics: list[float],
    world_to_camera: np.ndarray,
) -> bpy.types.Object:
    """Add one camera. Blender counts shifts in widths of the image, a pixel's height as its pixel aspect says."""
    (width, height), (fx, fy, cx, cy) = size, intrinsics
    data = bpy.data.cameras.new(name)
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
    data.lens = fx * SENSOR_MM / width
    data.shift_x = (width / 2 - cx) / width
    data.shift_y = (cy - height / 2) / width * fx / fy
    camera = bpy.data.objects.new(name, data)
    rotation, translation = world_to_camera[:, :3], world_to_camera[:, 3]
    placed = np.eye(4)
    placed[:3, :3] = bridge.to_blender((rotation.T @ LOOKS_DOWN_Z).T).T
    placed[:3, 3] = bridge.to_blender((-rotation.T @ translation)[None])[0]
    camera.matrix_world = Matrix(placed.tolist())
    collection.objects.link(camera)
    return camera
