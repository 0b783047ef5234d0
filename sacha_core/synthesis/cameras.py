"""The camera rig: sixteen cameras in three rows around the front of the head, as NeRSemble's."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.raster.camera import Camera

__all__ = ["FRONT_CAMERA", "N_CAMERAS", "camera_rig"]

# Azimuth towards the subject's left and elevation, degrees; camera 8 looks straight at the face.
PLACES = (
    *((azimuth, 18.0) for azimuth in (-46.0, -23.0, 0.0, 23.0, 46.0)),
    *((azimuth, 0.0) for azimuth in (-56.0, -36.0, -17.0, 0.0, 17.0, 36.0, 56.0)),
    *((azimuth, -14.0) for azimuth in (-42.0, -14.0, 14.0, 42.0)),
)
N_CAMERAS = len(PLACES)
FRONT_CAMERA = 8
DISTANCE_M = 1.0
TARGET_M = (0.0, -0.025, -0.02)  # the middle of a FLAME head with its neck
FOCAL_OVER_HEIGHT = 2.3  # the 0.35 m of head, hair and neck fill four fifths of the picture's height


def camera_rig(
    width: int,
    height: int,
    target_m: Float[np.ndarray, "3"] | tuple[float, float, float] = TARGET_M,
    distance_m: float = DISTANCE_M,
    focal_over_height: float = FOCAL_OVER_HEIGHT,
) -> tuple[Camera, ...]:
    """Give the rig.

    Args:
        width: of the pictures, pixels.
        height: pixels.
        target_m: the point that all cameras look at; the middle of a FLAME head at the origin by default.
        distance_m: from there to the cameras.
        focal_over_height: focal length in heights of the picture.

    Returns:
        Sixteen cameras; index `FRONT_CAMERA` is in front of the face.
    """
    target = np.array(target_m, np.float64)
    cameras = []
    for azimuth_deg, elevation_deg in PLACES:
        azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
        towards = np.array(
            [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
        )
        cameras.append(Camera.look_at(target + distance_m * towards, target, width, height, focal_over_height * height))
    return tuple(cameras)
