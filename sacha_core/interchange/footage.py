"""Footage: pictures of a head that another program animates and renders, with its cameras and the parameters of each frame.

A folder of `footage.json`: `subject`, `take`, `origin` (what made the pictures, as plain values), `views` (for each picture `timestep`,
`camera_index`, `width`, `height`, `K`, `world_to_camera` in OpenCV's axes, and `file`), and `checked` (timesteps); `flame_param.npz`, one
row for each timestep; `posed.npy` (m, v, 3) float32, the head's vertices at the checked timesteps as the other program has them, metres,
y up; `unposed.npy` (v, 3) float32, the person's neutral head there; and the pictures, PNG with alpha.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.errors import DatasetError, FormatError, HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, person_template
from sacha_core.interchange.gaussian_avatars import read_flame_param
from sacha_core.interchange.image_file import BROKEN_IMAGE, on_white
from sacha_core.raster.camera import Camera

__all__ = ["Footage", "FootageView", "read_footage", "read_picture", "with_own_shape"]

POSED_TOLERANCE_M = (
    5e-4  # half a millimetre: float32 rigs agree to a hundredth of one, another pose or a sculpted head does not
)
SHAPE_TOLERANCE_M = 1e-6  # what float32 leaves of a head of 0.3 m, and less than anybody sculpts
LARGEST_SIDE = 16_384


@dataclass(frozen=True)
class FootageView:
    """One picture.

    Args:
        timestep: row of the parameters.
        camera_index: which camera, 0 and up.
        camera: that camera, at this timestep.
        path: the picture; it may not have been made yet.
    """

    timestep: int
    camera_index: int
    camera: Camera
    path: Path


@dataclass(frozen=True)
class Footage:
    """Footage that was read and checked, except the pictures.

    Args:
        subject: name of the person.
        take: name of the sequence.
        origin: what made the pictures.
        motion: parameters of each timestep.
        views: pictures, one for each timestep and camera.
        checked: timesteps of `posed`.
        posed: (m, v, 3) vertices there, metres.
        unposed: (v, 3) the person's neutral head, metres.
    """

    subject: str
    take: str
    origin: dict[str, Any]
    motion: Motion
    views: tuple[FootageView, ...]
    checked: tuple[int, ...]
    posed: Float[np.ndarray, "m v 3"]
    unposed: Float[np.ndarray, "v 3"]

    @property
    def cameras(self) -> tuple[int, ...]:
        """Indices of the cameras."""
        return tuple(sorted({view.camera_index for view in self.views}))


def read_footage(folder: Path) -> Footage:
    """Read footage; the pictures are not touched.

    Raises:
        DatasetError: something is missing or makes no sense; names the file.
        OSError: a file cannot be read.
    """
    path = folder / "footage.json"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        views = tuple(_view(folder, entry) for entry in told["views"])
        facts = str(told["subject"]), str(told["take"]), dict(told["origin"])
        checked = tuple(int(timestep) for timestep in told["checked"])
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise DatasetError(f"{path}: expected footage as the Blender add-on leaves it ({error!r})") from error
    try:
        motion = read_flame_param(folder / "flame_param.npz")
    except FormatError as error:
        raise DatasetError(str(error)) from error
    posed, unposed = _vertices(folder / "posed.npy", 3), _vertices(folder / "unposed.npy", 2)
    wanted = {(timestep, view.camera_index) for timestep in range(len(motion)) for view in views}
    if not views or wanted != {(view.timestep, view.camera_index) for view in views} or len(wanted) != len(views):
        raise DatasetError(f"{path}: expected one view for each of {len(motion)} timesteps and each camera")
    if len(checked) != len(posed) or not all(0 <= timestep < len(motion) for timestep in checked):
        raise DatasetError(f"{folder / 'posed.npy'} holds {len(posed)} heads, expected those of timesteps {checked}")
    return Footage(*facts, motion, views, checked, posed, unposed)


def with_own_shape(footage: Footage, head: HeadModel) -> Footage:
    """Take what the person's neutral head has beyond its identity coefficients as personal offsets, and hold its poses to the parameters.

    Raises:
        HeadError: the head has other vertices, or does not stand where the parameters say.
    """
    n_found = footage.unposed.shape[0]
    if n_found != head.n_vertices:
        raise HeadError(
            f"the filmed head has {n_found} vertices, head {head.name!r} has {head.n_vertices}; expected the head that was opened"
        )
    bare = replace(footage.motion, static_offset=np.zeros((0, 3), np.float32))
    offset = footage.unposed - person_template(head, bare)[0]
    own = np.abs(offset).max(initial=0.0) > SHAPE_TOLERANCE_M
    motion = replace(bare, static_offset=offset.astype(np.float32)) if own else bare
    poser = Poser(head, motion)
    for timestep, posed in zip(footage.checked, footage.posed, strict=True):
        away_m = np.linalg.norm(poser(timestep) - posed, axis=1)
        if not away_m.max() <= POSED_TOLERANCE_M:  # so that what is not finite is refused too
            vertex = int(np.argmax(away_m))
            raise HeadError(
                f"the head at timestep {timestep} is not where its parameters put it: vertex {vertex} is {1e3 * away_m[vertex]:.2f} mm"
                f" away, expected at most {1e3 * POSED_TOLERANCE_M:g}; is it moved by something else than its controls?"
            )
    return replace(footage, motion=motion)


def read_picture(view: FootageView) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "_ _"]]:
    """Read one picture: its colours on white, and what it covers.

    Raises:
        DatasetError: it is missing, cannot be decoded, or has another size or no alpha.
    """
    size = (view.camera.width, view.camera.height)
    try:
        with Image.open(view.path) as stored:
            if stored.size != size or "A" not in stored.getbands():
                found = f"{stored.mode} of {stored.size[0]} by {stored.size[1]} pixels"
                raise DatasetError(f"{view.path} is {found}, expected one with alpha of {size[0]} by {size[1]}")
            mask = np.asarray(stored.getchannel("A"))
            return np.asarray(on_white(stored)), mask
    except BROKEN_IMAGE as error:
        raise DatasetError(f"{view.path} cannot be decoded: {error}") from error


def _view(folder: Path, entry: dict[str, Any]) -> FootageView:
    width, height = int(entry["width"]), int(entry["height"])
    k, pose = np.array(entry["K"], np.float64), np.array(entry["world_to_camera"], np.float64)
    if k.shape != (3, 3) or pose.shape != (4, 4) or not (np.isfinite(k).all() and np.isfinite(pose).all()):
        raise ValueError("K is 3 by 3 and world_to_camera 4 by 4, all finite")
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE and k[0, 0] > 0 and k[1, 1] > 0):
        raise ValueError(f"a camera of {width} by {height} pixels and focal lengths {k[0, 0]:g} and {k[1, 1]:g}")
    camera = Camera(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], pose[:3, :3], pose[:3, 3])
    return FootageView(int(entry["timestep"]), int(entry["camera_index"]), camera, folder / str(entry["file"]))


def _vertices(path: Path, n_axes: int) -> Float[np.ndarray, "..."]:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise DatasetError(f"{path} is no array: {error}") from error
    if array.ndim != n_axes or array.shape[-1] != 3 or array.dtype.kind != "f" or not np.isfinite(array).all():
        raise DatasetError(f"{path} is {array.dtype} of shape {array.shape}, expected finite vertices")
    vertices: np.ndarray = array.astype(np.float32)
    return vertices
