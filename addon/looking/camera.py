# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's cameras as the engine's: intrinsics in pixels and the way from the engine's world to OpenCV's axes."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

__all__ = ["camera_file"]

FROM_ENGINE = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)  # as `bridge.to_blender`
TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # Blender's cameras look along -z with y up
UNEVEN = 1e-4  # how far three scales may be from each other: matrices are in single precision


def camera_file(
    camera: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    width: int,
    height: int,
    pixel_aspect: tuple[float, float] = (1.0, 1.0),
    world: Matrix | None = None,
) -> dict[str, Any]:
    """Describe a camera as `sacha render --camera-file` reads it.

    Args:
        camera: the camera's object; shift, sensor fit and whatever animates it count.
        depsgraph: at the frame that is meant.
        width: of the picture, pixels.
        height: of the picture, pixels.
        pixel_aspect: of the render settings, x and y.
        world: `matrix_world` of the object in whose space the engine draws; None for Blender's world. It may turn, move and scale evenly.

    Returns:
        `width`, `height`, `K`, `world_to_camera` and `near`, in the engine's metres.

    Raises:
        ValueError: the camera has no perspective, or the object is scaled unevenly or mirrored.
    """
    seen = camera.evaluated_get(depsgraph)
    if seen.data.type != "PERSP":
        raise ValueError(
            f"Camera {camera.name!r} has no perspective: the engine draws perspective alone; choose Perspective as its lens type"
        )
    lens = np.array(
        seen.calc_matrix_camera(depsgraph, x=width, y=height, scale_x=pixel_aspect[0], scale_y=pixel_aspect[1])
    )
    pose, scale = _pose(seen.matrix_world, world)
    return {
        "width": width,
        "height": height,
        "K": [
            [width / 2 * lens[0, 0], 0.0, width / 2 * (1 - lens[0, 2])],
            [0.0, height / 2 * lens[1, 1], height / 2 * (1 + lens[1, 2])],
            [0.0, 0.0, 1.0],
        ],
        "world_to_camera": pose.tolist(),
        "near": seen.data.clip_start / scale,
    }


def _pose(camera: Matrix, world: Matrix | None) -> tuple[np.ndarray, float]:
    """Give (4, 4) from the engine's world to OpenCV's axes, and by how much the object scales."""
    view = np.linalg.inv(np.array(camera.normalized(), np.float64))  # a camera's own scale does nothing
    space = np.eye(4) if world is None else np.array(world, np.float64)
    scales = np.linalg.norm(space[:3, :3], axis=0)
    scale = float(scales.mean())
    turn = space[:3, :3] / max(scale, 1e-30)
    if np.abs(turn @ turn.T - np.eye(3)).max() > UNEVEN or np.linalg.det(turn) < 0:
        raise ValueError("The head is scaled unevenly or mirrored: apply its scale (Object > Apply > Scale)")
    pose = TO_OPENCV @ view @ space @ FROM_ENGINE
    pose[:3] /= scale  # what is seen stays the same when everything shrinks towards the camera
    pose[3] = (0, 0, 0, 1)
    return pose, scale
