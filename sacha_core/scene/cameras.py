"""The cameras of a capture, as a program that shows them wants them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.interchange.capture import Capture, View

__all__ = ["Cameras", "cameras_of"]


@dataclass(frozen=True)
class Cameras:
    """m pinhole cameras; axes of the world y up, of a camera x right, y down, z forward; metres.

    Args:
        names: of the cameras.
        sizes: (m, 2) width and height, pixels.
        intrinsics: (m, 4) fx, fy, cx, cy, pixels; pixel centres lie at +0.5.
        world_to_camera: (m, 3, 4) rotation and translation, float64.
    """

    names: list[str]
    sizes: Int[np.ndarray, "m 2"]
    intrinsics: Float[np.ndarray, "m 4"]
    world_to_camera: Float[np.ndarray, "m 3 4"]


def cameras_of(capture: Capture) -> Cameras:
    """Give each camera of a capture once, by number; one that was moved between sequences, once for each place."""
    places: dict[tuple[int, bytes], View] = {}
    for view in (*capture.train, *capture.val, *capture.test):
        camera = view.camera
        numbers = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
        place = np.array([*numbers, *camera.rotation.ravel(), *camera.translation], np.float64).tobytes()
        earlier = places.get((view.camera_index, place))
        if earlier is None or view.timestep < earlier.timestep:
            places[view.camera_index, place] = view
    views = sorted(places.values(), key=lambda view: (view.camera_index, view.timestep))
    cameras = [view.camera for view in views]
    return Cameras(
        _names([view.camera_index for view in views]),
        np.array([(camera.width, camera.height) for camera in cameras], np.int32),
        np.array([(camera.fx, camera.fy, camera.cx, camera.cy) for camera in cameras]),
        np.array([np.column_stack([camera.rotation, camera.translation]) for camera in cameras]),
    )


def _names(numbers: list[int]) -> list[str]:
    """Name cameras by their numbers, with a count behind it where a number stands for several places."""
    names: list[str] = []
    for row, number in enumerate(numbers):
        earlier = numbers[:row].count(number)
        names.append(f"camera_{number:02d}" + (f"_{earlier + 1}" if earlier else ""))
    return names
