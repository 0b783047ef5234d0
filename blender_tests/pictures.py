"""Pictures of a mesh as an artist sees it, flat and exact, and its numbers; for tests in any Blender, with pytest or without."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

__all__ = ["FRONT_LEFT", "look_at", "read", "render", "srgb"]

FRONT_LEFT = (0.5, -1.0, 0.15)


def read(collection: bpy.types.bpy_prop_collection, name: str, width: int, kind: type = np.float32) -> np.ndarray:
    """Give (n, width) values of a collection."""
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, to bytes."""
    linear = linear.astype(np.float64)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)


def look_at(
    shown: bpy.types.Object, size: int, towards: tuple[float, float, float] = FRONT_LEFT, *, flat: bool = True
) -> bpy.types.Object:
    """Make the scene one whose picture shows nothing but a mesh, whole and without perspective, in the colours that it has.

    Args:
        shown: the mesh.
        size: of the picture, pixels each way.
        towards: direction from the mesh to the camera.
        flat: exact colours; otherwise lit and smoothed, for people.
    """
    scene = bpy.context.scene
    for other in bpy.data.objects:
        other.hide_render = other is not shown
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.film_transparent, scene.render.dither_intensity = True, 0
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.display.render_aa = "OFF" if flat else "16"
    scene.display.shading.light = "FLAT" if flat else "STUDIO"
    scene.display.shading.color_type = "VERTEX"
    scene.view_settings.view_transform = "Standard"
    corners = np.array([list(shown.matrix_world @ Vector(corner)) for corner in shown.bound_box])
    height = float(np.ptp(corners[:, 2]))
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale, lens.clip_end = "ORTHO", 1.1 * height, 10 * height
    camera = scene.camera = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(camera)
    direction = Vector(towards).normalized()
    camera.location = Vector(corners.mean(axis=0)) + direction * 3 * height
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    bpy.context.view_layer.update()
    return camera


def render(path: Path) -> np.ndarray:
    """Draw the scene into a PNG file and give its (h, w, 4) bytes, row 0 at the bottom."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Non-Color"
    width, height = picture.size
    values = np.empty(width * height * 4, np.float32)
    picture.pixels.foreach_get(values)
    bpy.data.images.remove(picture)
    return np.rint(values.reshape(height, width, 4) * 255).astype(np.uint8)
