"""A camera of another program, as JSON: what it takes to draw the very same view.

The file holds `width` and `height` in pixels; `K`, three rows of three: focal lengths and principal point in pixels from the
image's top left corner, without skew; `world_to_camera`, four rows of four: a rotation and a translation in metres to OpenCV's axes
(x right, y down, z forward), from a world with y up; and, where it is not the rasteriser's own, `near`: what is closer to the camera's
plane is not drawn, metres.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.errors import FormatError
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import NEAR
from sacha_core.raster.view import MAX_SIDE

__all__ = ["PlacedCamera", "read_camera_file"]

MAX_BYTES = 1 << 16  # some hundred are enough
ROTATION_ERROR = 1e-3  # of R R^T from the identity: matrices come in single precision, scaled ones are far off


@dataclass(frozen=True)
class PlacedCamera:
    """A camera, and from where on it sees.

    Args:
        camera: the camera.
        near: what is closer to its plane is not drawn, metres.
    """

    camera: Camera
    near: float = NEAR


def read_camera_file(path: Path) -> PlacedCamera:
    """Read a camera.

    Raises:
        FormatError: it is no JSON object, or a number is missing, not finite, or makes no camera.
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        text = stream.read(MAX_BYTES + 1)
    try:
        return _placed(_object(text))
    except (FormatError, ValueError, RecursionError) as error:
        raise FormatError(f"{path}: {error}") from error


def _object(text: bytes) -> dict[str, Any]:
    if len(text) > MAX_BYTES:
        raise FormatError(f"more than {MAX_BYTES} bytes are no camera")
    told = json.loads(text)
    if not isinstance(told, dict):
        raise FormatError("expected a JSON object")
    return told


def _placed(told: dict[str, Any]) -> PlacedCamera:
    width, height = _side(told, "width"), _side(told, "height")
    intrinsics, pose = _matrix(told, "K", 3), _matrix(told, "world_to_camera", 4)
    (fx, skew, cx), (below, fy, cy), last = intrinsics
    if not (fx > 0 and fy > 0 and skew == below == 0 and list(last) == [0, 0, 1]):
        raise FormatError("K is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with focal lengths above 0")
    rotation = pose[:3, :3]
    wrong = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if wrong > ROTATION_ERROR or np.linalg.det(rotation) < 0 or list(pose[3]) != [0, 0, 0, 1]:
        raise FormatError("world_to_camera is no rotation and translation: it scales, shears or mirrors")
    near = told.get("near", NEAR)
    if isinstance(near, bool) or not isinstance(near, int | float) or not 0 < near < math.inf:
        raise FormatError(f"near is {near!r}, expected metres above 0")
    camera = Camera(width, height, float(fx), float(fy), float(cx), float(cy), rotation, pose[:3, 3])
    return PlacedCamera(camera, float(near))


def _side(told: dict[str, Any], name: str) -> int:
    side = told.get(name)
    if isinstance(side, bool) or not isinstance(side, int) or not 1 <= side <= MAX_SIDE:
        raise FormatError(f"{name} is {side!r}, expected 1 to {MAX_SIDE} pixels")
    return side


def _matrix(told: dict[str, Any], name: str, size: int) -> np.ndarray:
    rows = told.get(name)
    shaped = isinstance(rows, list) and len(rows) == size and all(isinstance(r, list) and len(r) == size for r in rows)
    numbers = [number for row in rows for number in row] if shaped and rows is not None else []
    if not numbers or not all(isinstance(x, int | float) and math.isfinite(x) for x in numbers):
        raise FormatError(f"{name} is missing or not {size} rows of {size} finite numbers")
    return np.array(rows, np.float64)
