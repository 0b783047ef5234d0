# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras around a head, to film it from: three rows in front of the face, as in NeRSemble's captures, or a full ring."""

from __future__ import annotations

from math import atan, cos, pi, radians, sin

import bpy
from bpy.props import FloatProperty, IntProperty
from mathutils import Vector

from .. import problem
from .heads import head_of

__all__ = ["CLASSES", "COLLECTION", "directions"]

COLLECTION = "SACHA Cameras"
MARK = "sacha_ring"  # property of the cameras made here: only these are replaced
MIDDLE_SHARE = 7 / 16  # of the cameras, in the row that looks straight ahead
FILLED = 0.8  # part of the picture's height that the head fills
FULL_RING_DEG = 360.0


class SachaAddCameras(bpy.types.Operator):
    """Put cameras around the active head, in the place of those that were put there before."""

    bl_idname = "sacha.add_cameras"
    bl_label = "Add Cameras"
    bl_description = "Put cameras around the active head, in the place of those that were put there before"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it as it is)

    count: IntProperty(name="Cameras", description="How many", default=16, min=2, max=256)
    arc_deg: FloatProperty(
        name="Arc",
        description="Degrees that they are spread over, the face in the middle",
        default=112.0,
        min=0.0,
        max=360.0,
    )
    elevation_deg: FloatProperty(
        name="Elevation",
        description="Degrees by which the upper and the lower row look down and up",
        default=16.0,
        min=0.0,
        max=80.0,
    )
    distance: FloatProperty(
        name="Distance", description="From the head's middle", default=1.0, min=0.01, subtype="DISTANCE"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Put them there."""
        try:
            head = head_of(context)
        except ValueError as error:
            return problem.tell(self, str(error))
        corners = [head.matrix_world @ Vector(corner) for corner in head.bound_box]
        middle = sum(corners, Vector()) / len(corners)
        radius = max((corner - middle).length for corner in corners)
        collection = _emptied_collection(context.scene)
        for number, direction in enumerate(directions(self.count, self.arc_deg, self.elevation_deg)):
            camera = _add_camera(collection, number, middle + self.distance * Vector(direction), middle)
            camera.data.angle_y = 2 * atan(radius / FILLED / self.distance)
        context.scene.sacha_making.film_cameras = collection
        return {"FINISHED"}


def directions(count: int, arc_deg: float, elevation_deg: float) -> list[tuple[float, float, float]]:
    """Give unit vectors from a head that looks along Blender's -y to its cameras: the middle row first, one of it straight ahead."""
    middle = round(count * MIDDLE_SHARE) | 1
    above = (count - middle + 1) // 2
    rows = ((middle, 0.0), (above, elevation_deg), (count - middle - above, -elevation_deg))
    return [direction for n, elevation in rows for direction in _row(n, arc_deg, radians(elevation))]


def _row(n: int, arc_deg: float, elevation: float) -> list[tuple[float, float, float]]:
    steps = n if arc_deg >= FULL_RING_DEG else max(n - 1, 1)  # a full ring does not end where it began
    around = [arc_deg / 180 * pi * ((i - (n - 1) / 2) / steps) for i in range(n)]
    return [(sin(angle) * cos(elevation), -cos(angle) * cos(elevation), sin(elevation)) for angle in around]


def _emptied_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """Give the scene's collection of these cameras, without those that were put there before."""
    collection = next((child for child in scene.collection.children if child.name.startswith(COLLECTION)), None)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        scene.collection.children.link(collection)
    for camera in [camera for camera in collection.objects if MARK in camera]:
        data = camera.data
        bpy.data.objects.remove(camera)
        if data is not None and not data.users:
            bpy.data.cameras.remove(data)
    return collection


def _add_camera(collection: bpy.types.Collection, number: int, place: Vector, target: Vector) -> bpy.types.Object:
    """Add a camera that looks from a place at a target, upright."""
    camera = bpy.data.objects.new(f"sacha {number:02d}", bpy.data.cameras.new(f"sacha {number:02d}"))
    camera[MARK] = number
    camera.location = place
    camera.rotation_euler = (target - place).to_track_quat("-Z", "Y").to_euler()
    camera.data.sensor_fit = "VERTICAL"
    camera.data.clip_start = 0.01
    collection.objects.link(camera)
    return camera


CLASSES = (SachaAddCameras,)
