"""The `transforms*.json` files of a NeRF-style capture: one camera and the paths of one image per frame."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from sacha_core.errors import DatasetError
from sacha_core.files import write_aside
from sacha_core.raster.camera import Camera

__all__ = ["FrameRecord", "camera_to_world_opengl", "read_transforms", "write_transforms"]

OPENGL_TO_OPENCV = np.array(
    [1.0, -1.0, -1.0, 1.0]
)  # sign of the columns of a camera-to-world matrix: y and z turn round
RIGID_TOLERANCE = 1e-4  # how far rotation.T @ rotation may be from identity: float32 exports stay below 1e-6
FOCAL_RANGE = (0.1, 100.0)  # focal length over image width: 157 degrees of view to 0.6
LARGEST_SIDE = 1 << 15  # pixels; beyond it a size is a mistake or an attack on memory


@dataclass(frozen=True)
class FrameRecord:
    """One frame of a `transforms*.json`, checked.

    Args:
        timestep: index of the moment, 0 and up.
        camera_index: index of the camera in the rig.
        camera_id: serial number or name of the camera.
        camera: intrinsics and pose, OpenCV's axes.
        file_path: image, relative to the file's folder.
        fg_mask_path: foreground mask, likewise; None where the frame names none.
        flame_param_path: parameters of the timestep, likewise.
    """

    timestep: int
    camera_index: int
    camera_id: str
    camera: Camera
    file_path: str
    fg_mask_path: str | None
    flame_param_path: str


def camera_to_world_opengl(camera: Camera) -> Float[np.ndarray, "4 4"]:
    """Give the pose of a camera as such files keep it: camera to world, x right, y up, z backward."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera.rotation.T
    matrix[:3, 3] = camera.centre
    opengl: np.ndarray = matrix * OPENGL_TO_OPENCV
    return opengl


def write_transforms(
    path: Path, records: Sequence[FrameRecord], single_sequence: bool = False, extra: dict[str, Any] | None = None
) -> None:
    """Write frames as GaussianAvatars' reader expects them; the top level repeats the last frame's intrinsics.

    Args:
        path: the `.json` file to write.
        records: its frames, in order.
        single_sequence: write also the keys that a union of sequences drops.
        extra: further keys of the top level.

    Raises:
        OSError: the file cannot be written.
    """
    frames = [frame_json(record, single_sequence) for record in records]
    intrinsics = {key: frames[-1][key] for key in INTRINSIC_KEYS} if frames else {}
    document = {
        **intrinsics,
        "timestep_indices": sorted({record.timestep for record in records}),
        "camera_indices": sorted({record.camera_index for record in records}),
        **(extra or {}),
        "frames": frames,
    }
    with write_aside(path) as aside:
        aside.write_text(json.dumps(document, indent=1), encoding="utf-8")


INTRINSIC_KEYS = ("cx", "cy", "fl_x", "fl_y", "h", "w", "camera_angle_x", "camera_angle_y")


def frame_json(record: FrameRecord, single_sequence: bool) -> dict[str, Any]:
    """Give one frame as its JSON object."""
    camera = record.camera
    original = {"timestep_index_original": record.timestep, "timestep_id": f"{record.timestep:05d}"}
    return {
        "timestep_index": record.timestep,
        **(original if single_sequence else {}),
        "camera_index": record.camera_index,
        "camera_id": record.camera_id,
        "cx": camera.cx,
        "cy": camera.cy,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "h": camera.height,
        "w": camera.width,
        "camera_angle_x": 2 * math.atan(camera.width / (2 * camera.fx)),
        "camera_angle_y": 2 * math.atan(camera.height / (2 * camera.fy)),
        "transform_matrix": camera_to_world_opengl(camera).tolist(),
        "file_path": record.file_path,
        **({} if record.fg_mask_path is None else {"fg_mask_path": record.fg_mask_path}),
        "flame_param_path": record.flame_param_path,
    }


def read_transforms(path: Path) -> tuple[FrameRecord, ...]:
    """Read and check the frames of one file; the files that they name are not touched.

    Intrinsics may stand in each frame or at the top level, and a missing focal length is taken from the viewing angle.

    Raises:
        DatasetError: not JSON, or a frame lacks something or has a value that makes no sense; names file, frame and key.
        OSError: the file cannot be read.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:  # also a file that is not UTF-8
        raise DatasetError(f"{path} is not JSON: {error}") from error
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list):
        raise DatasetError(f'{path} has no list "frames"')
    defaults = {key: document[key] for key in INTRINSIC_KEYS if key in document}
    records = []
    for index, frame in enumerate(frames):
        if not isinstance(frame, dict):
            raise DatasetError(f"{path}, frame {index}: expected an object, found {type(frame).__name__}")
        records.append(parse_frame(Fields(f"{path}, frame {index}", {**defaults, **frame})))
    return tuple(records)


@dataclass(frozen=True)
class Fields:
    """The values of one frame, fetched by key with their kind checked.

    Args:
        where: file and frame, for messages.
        values: the JSON object.
    """

    where: str
    values: dict[str, Any]

    def number(self, key: str) -> float:
        """Give a finite number."""
        value = self.values.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise DatasetError(f"{self.where}: {key} is {value!r}, expected a finite number")
        return float(value)

    def index(self, key: str, upper: int = 1 << 24) -> int:
        """Give a whole number from 0 to `upper`."""
        value = self.number(key)
        if value != int(value) or not 0 <= value <= upper:
            raise DatasetError(f"{self.where}: {key} is {value:g}, expected a whole number from 0 to {upper}")
        return int(value)

    def path(self, key: str) -> str:
        """Give a path, which must be text and not empty."""
        value = self.values.get(key)
        if not isinstance(value, str) or not value or "\0" in value:
            raise DatasetError(f"{self.where}: {key} is {value!r}, expected a path")
        return value

    def focal(self, axis: str, n_pixels: int) -> float:
        """Give the focal length along an axis, pixels."""
        key, angle_key = f"fl_{axis}", f"camera_angle_{axis}"
        if key in self.values or angle_key not in self.values:
            focal = self.number(key)
        else:
            focal = n_pixels / (2 * math.tan(self.number(angle_key) / 2) or math.nan)
        low, high = FOCAL_RANGE
        if not low * n_pixels <= focal <= high * n_pixels:
            raise DatasetError(
                f"{self.where}: focal length {key} is {focal:g} pixels, expected {low} to {high:g} times the {n_pixels} of the image"
            )
        return focal

    def principal(self, axis: str, n_pixels: int) -> float:
        """Give the principal point along an axis, pixels; the middle where the frame names none."""
        key = f"c{axis}"
        if key not in self.values:
            return n_pixels / 2
        value = self.number(key)
        if not -n_pixels <= value <= 2 * n_pixels:
            raise DatasetError(
                f"{self.where}: principal point {key} is {value:g}, far outside an image of {n_pixels} pixels"
            )
        return value

    def pose(self) -> Float[np.ndarray, "4 4"]:
        """Give the camera-to-world matrix, OpenGL's axes, checked to be rigid."""
        value = self.values.get("transform_matrix")
        try:
            matrix = np.array(value, np.float64)
        except (TypeError, ValueError):
            matrix = np.empty(0)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise DatasetError(f"{self.where}: transform_matrix is not 4 by 4 finite numbers")
        rotation = matrix[:3, :3]
        error = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if error > RIGID_TOLERANCE or np.linalg.det(rotation) < 0 or np.any(matrix[3] != (0, 0, 0, 1)):
            raise DatasetError(
                f"{self.where}: transform_matrix is not a rigid motion (rotation off by {error:.2g}, "
                f"determinant {np.linalg.det(rotation):.3g}, last row {matrix[3].tolist()})"
            )
        return matrix


def parse_frame(fields: Fields) -> FrameRecord:
    """Turn one JSON object into a record; `Fields` raises where a value makes no sense."""
    width, height = fields.index("w", LARGEST_SIDE), fields.index("h", LARGEST_SIDE)
    if width == 0 or height == 0:
        raise DatasetError(f"{fields.where}: image of {width} by {height} pixels")
    fx = fields.focal("x", width)
    fy = fields.focal("y", height) if {"fl_y", "camera_angle_y"} & fields.values.keys() else fx
    to_world = fields.pose() * OPENGL_TO_OPENCV
    rotation = np.ascontiguousarray(to_world[:3, :3].T)
    camera = Camera(
        width,
        height,
        fx,
        fy,
        fields.principal("x", width),
        fields.principal("y", height),
        rotation,
        -rotation @ to_world[:3, 3],
    )
    return FrameRecord(
        timestep=fields.index("timestep_index"),
        camera_index=fields.index("camera_index"),
        camera_id=str(fields.values.get("camera_id", fields.index("camera_index"))),
        camera=camera,
        file_path=fields.path("file_path"),
        fg_mask_path=fields.path("fg_mask_path") if "fg_mask_path" in fields.values else None,
        flame_param_path=fields.path("flame_param_path"),
    )
