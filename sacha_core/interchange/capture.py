"""A multi-view capture of a head in the layout of GaussianAvatars and NeRSemble: the way training gets its data.

A folder is either one sequence (images, masks and parameters of its own) or a union of several (`UNION..._...`, whose frames name files in
the sequences' folders beside it). `timestep_index` is global to the folder that is read, and is the frame of `Capture.motion`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from sacha_core.avatar.motion import DYNAMIC_WIDTHS, Motion
from sacha_core.errors import DatasetError, FormatError
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadReference
from sacha_core.interchange.gaussian_avatars import THEIR_VERTICES, fitted_offsets, read_flame_param
from sacha_core.interchange.image_file import BROKEN_IMAGE, on_white
from sacha_core.interchange.transforms import FrameRecord, read_transforms
from sacha_core.raster.camera import Camera

__all__ = ["Capture", "View", "is_capture", "read_capture", "write_head_reference"]

SPLITS = ("train", "val", "test")
CANONICAL = "canonical_flame_param.npz"
HEAD_JSON = "head.json"
DYNAMIC = ("expression", *DYNAMIC_WIDTHS)


@dataclass(frozen=True)
class View:
    """One image of a capture.

    Args:
        timestep: frame of the capture's motion.
        camera_index: which camera of the rig took it. Its pose may differ between sequences: use `camera`.
        camera: the camera at the stored resolution.
        image_path: the picture, RGB on white or RGBA.
        mask_path: foreground mask, 8 bit; None where there is none.
    """

    timestep: int
    camera_index: int
    camera: Camera
    image_path: Path
    mask_path: Path | None


@dataclass(frozen=True)
class Capture:
    """A capture that was read and checked; images are decoded when asked for.

    Args:
        root: its folder.
        head: the head that its parameters belong to; None where the folder has no `head.json` (GaussianAvatars' own data).
        head_path: file of that head, where `head.json` names one that exists.
        motion: parameters of all timesteps; shape and static offset are those of timestep 0, as in GaussianAvatars.
        train: views to train on.
        val: views of the held-out camera at training timesteps.
        test: views of held-out timesteps.
    """

    root: Path
    head: HeadReference | None
    head_path: Path | None
    motion: Motion
    train: tuple[View, ...]
    val: tuple[View, ...]
    test: tuple[View, ...]

    def image(self, view: View, width: int | None = None, height: int | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """Decode one image, on white, at a resolution; `view.camera.resized(width, height)` is its camera.

        Shrinking by whole factors averages boxes of pixels, any other change of size uses Lanczos' filter. Alpha is composited before.

        Args:
            view: one of this capture's views.
            width: pixels; the stored width by default.
            height: pixels; the stored height by default.

        Raises:
            DatasetError: the file cannot be decoded; the message names it.
        """
        width, height = width or view.camera.width, height or view.camera.height
        try:
            with Image.open(view.image_path) as stored:
                picture = on_white(stored)
        except BROKEN_IMAGE as error:
            raise DatasetError(f"{view.image_path} cannot be decoded: {error}") from error
        if picture.size == (width, height):
            return np.asarray(picture)
        if picture.width % width == 0 and picture.height % height == 0:
            return np.asarray(picture.reduce((picture.width // width, picture.height // height)))
        return np.asarray(picture.resize((width, height), Image.Resampling.LANCZOS))

    def load_images(
        self, views: Sequence[View], width: int, height: int, threads: int | None = None
    ) -> UInt8[np.ndarray, "m h w 3"]:
        """Decode many images by several threads, in the order of `views`.

        Args:
            views: m views.
            width: pixels.
            height: pixels.
            threads: how many; as many as the machine has cores by default.

        Raises:
            DatasetError: a file cannot be decoded; the message names it.
        """
        images = np.empty((len(views), height, width, 3), np.uint8)

        def load(row: int) -> None:
            images[row] = self.image(views[row], width, height)

        with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
            for _ in pool.map(load, range(len(views))):
                pass
        return images


def read_capture(root: str | os.PathLike[str]) -> Capture:
    """Read a capture and check all of it except the pixels.

    Every image and mask must exist with the size that its frame says (only headers are read), every timestep must have finite parameters of
    one shape, timesteps must count from 0 without a gap, and no split of a union may be empty.

    Args:
        root: a union folder, a folder of one sequence, or a folder that holds one union folder.

    Returns:
        The capture; views are in the order of the files.

    Raises:
        DatasetError: something is missing or makes no sense; the message names the file and what was expected.
    """
    folder = capture_folder(Path(root))
    is_union = not (folder / "transforms.json").exists()
    records = {split: split_records(folder, split, is_union) for split in SPLITS}
    everything = [record for split in SPLITS for record in records[split]]
    if not records["train"]:
        raise DatasetError(f"{folder / 'transforms_train.json'} has no frames; there is nothing to train on")
    motion = read_motion(folder, everything)
    sizes: dict[Path, tuple[int, int]] = {}
    views = {split: tuple(checked_view(folder, record, sizes) for record in records[split]) for split in SPLITS}
    head, head_path = read_head_reference(folder)
    motion = fitted_offsets(motion, THEIR_VERTICES if head is None else head.n_vertices)
    return Capture(folder, head, head_path, motion, views["train"], views["val"], views["test"])


def is_capture(root: Path) -> bool:
    """Tell a capture's folder from others: it has the frames to train on, or a union folder that has."""
    return (root / "transforms_train.json").is_file() or any(root.glob("UNION*/transforms_train.json"))


def capture_folder(root: Path) -> Path:
    """Find the folder with the transforms: `root`, or the one union folder in it."""
    if (root / "transforms_train.json").is_file():
        return root
    if not root.is_dir():
        raise DatasetError(f"{root} is not a folder; expected a capture in GaussianAvatars' layout")
    unions = sorted(path.parent for path in root.glob("UNION*/transforms_train.json"))
    if len(unions) != 1:
        raise DatasetError(
            f"{root} has no transforms_train.json, and {len(unions) or 'no'} UNION folder{'s' * (len(unions) > 1)} with one; "
            "expected a capture in GaussianAvatars' layout"
        )
    return unions[0]


def split_records(folder: Path, split: str, is_union: bool) -> tuple[FrameRecord, ...]:
    """Read the frames of one split; a union has all three and none is empty, a sequence may lack `val` and `test`."""
    path = folder / f"transforms_{split}.json"
    if not path.is_file():
        if is_union or split == "train":
            raise DatasetError(f"{path} does not exist; a capture has transforms_train.json, _val.json and _test.json")
        return ()
    records = read_transforms(path)
    if is_union and not records:
        raise DatasetError(f"{path} has no frames; a union of sequences has some in each split")
    return records


def checked_view(folder: Path, record: FrameRecord, sizes: dict[Path, tuple[int, int]]) -> View:
    """Turn a record into a view, with the sizes of its image and mask checked; `sizes` remembers headers already read."""
    name = record.file_path if Path(record.file_path).suffix == ".png" else f"{record.file_path}.png"
    image_path = folder / name
    mask_path = None if record.fg_mask_path is None else folder / record.fg_mask_path
    if mask_path is not None and not mask_path.exists():
        mask_path = None
    expected = (record.camera.width, record.camera.height)
    for path in (image_path, mask_path):
        if path is None:
            continue
        if path not in sizes:
            sizes[path] = header_size(path)
        if sizes[path] != expected:
            width, height = sizes[path]
            raise DatasetError(f"{path} is {width} by {height} pixels, its frame says {expected[0]} by {expected[1]}")
    return View(record.timestep, record.camera_index, record.camera, image_path, mask_path)


def header_size(path: Path) -> tuple[int, int]:
    """Give width and height of an image file from its header."""
    try:
        with Image.open(path) as picture:
            width, height = picture.size
    except FileNotFoundError as error:
        raise DatasetError(f"image {path} does not exist, though a frame names it") from error
    except BROKEN_IMAGE as error:
        raise DatasetError(f"{path} is not an image that can be read: {error}") from error
    return width, height


def read_motion(folder: Path, records: Iterable[FrameRecord]) -> Motion:
    """Read the parameters of every timestep into one motion, whose frame t is timestep t."""
    paths: dict[int, str] = {}
    for record in records:
        known = paths.setdefault(record.timestep, record.flame_param_path)
        if known != record.flame_param_path:
            raise DatasetError(
                f"{folder}: timestep {record.timestep} has two parameter files, {known} and {record.flame_param_path}"
            )
    n_timesteps = max(paths) + 1
    if len(paths) != n_timesteps:
        gap = next(t for t in range(n_timesteps) if t not in paths)
        raise DatasetError(
            f"{folder}: no frame has timestep_index {gap}, though there are {n_timesteps - 1}; they count from 0 without a gap"
        )
    moments = [read_moment(folder / paths[t]) for t in range(n_timesteps)]
    first = moments[0]
    for t, moment in enumerate(moments):
        for name in ("shape", "static_offset", "expression"):
            shape, expected = getattr(moment, name).shape, getattr(first, name).shape
            if shape != expected:
                raise DatasetError(f"{folder / paths[t]}: {name} has shape {shape}, at timestep 0 it is {expected}")
    stacked = {name: np.concatenate([getattr(moment, name) for moment in moments]) for name in DYNAMIC}
    return Motion(first.shape, first.static_offset, **stacked, frame_rate=first.frame_rate)


def read_moment(path: Path) -> Motion:
    """Read the parameters of one timestep."""
    if not path.is_file():
        raise DatasetError(f"parameters {path} do not exist, though a frame names them")
    try:
        moment = read_flame_param(path)
    except (FormatError, OSError) as error:
        raise DatasetError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
    if len(moment) != 1:
        raise DatasetError(f"{path} holds {len(moment)} frames, expected 1: the parameters of one timestep")
    return moment


def read_head_reference(folder: Path) -> tuple[HeadReference | None, Path | None]:
    """Read which head the parameters belong to, and its file where there is one."""
    path = folder / HEAD_JSON
    if not path.is_file():
        return None, None
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
        head = HeadReference(str(entry["name"]), str(entry["sha256"]), int(entry["n_vertices"]), int(entry["n_faces"]))
        file = entry.get("file")
        head_path = folder / str(file) if file else None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise DatasetError(f"{path}: expected name, sha256, n_vertices and n_faces of a head ({error!r})") from error
    return head, head_path if head_path is not None and head_path.is_file() else None


def write_head_reference(folder: Path, head: HeadReference) -> None:
    """Write which head the parameters of a capture or a model belong to, for `read_head_reference`.

    Raises:
        OSError: the folder cannot be made or written.
    """
    with write_aside(folder / HEAD_JSON) as aside:
        aside.write_text(json.dumps({**asdict(head), "file": None}, indent=2) + "\n", encoding="utf-8")
