"""Writing a multi-view capture in the layout that `capture` reads: a folder for each sequence and one union of them all."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from sacha_core.avatar.motion import Motion
from sacha_core.errors import DatasetError
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadReference
from sacha_core.interchange.capture import CANONICAL, HEAD_JSON
from sacha_core.interchange.gaussian_avatars import write_flame_param
from sacha_core.interchange.transforms import FrameRecord, read_transforms, write_transforms
from sacha_core.raster.camera import Camera

__all__ = ["CaptureWriter", "SequenceWriter"]

CANONICAL_JAW_RAD = 0.3  # the mouth a little open, as VHAP's canonical parameters
PNG_LEVEL = 1  # of zlib: three times as quick as Pillow's default for a tenth more bytes
TEST_FRACTION = 0.1  # of a single sequence's timesteps, the last ones
EVERYTHING = "transforms.json"  # written last: a sequence that has it is complete


@dataclass(frozen=True)
class CaptureWriter:
    """Writes one subject's capture.

    ```
    writer = CaptureWriter(root, "anna", head.reference)
    for name, motion in sequences:
        sequence = writer.sequence(name, motion, range(16))
        if not sequence.is_complete():
            for ...: sequence.add(timestep, camera_index, camera, image, mask)   # from any thread
            sequence.finish()
    union = writer.finish(train=[...], test=[...])
    ```

    Args:
        root: folder that will hold the sequences' folders and the union.
        subject: its name; no `_`, which separates the parts of a folder's name.
        head: the head that the parameters belong to.
        head_file: file of that head, if one lies somewhere; written relative to the folders.
        validation_camera: index of the camera held out of training.
        tag: last part of the folders' names.
        origin: what made the images (options, seed): a sequence on disk is kept only if it was made from the same.
    """

    root: Path
    subject: str
    head: HeadReference | None = None
    head_file: Path | None = None
    validation_camera: int = 8
    tag: str = "v16_whiteBg"
    origin: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_plain("subject", self.subject)

    def sequence(self, name: str, motion: Motion, camera_indices: Iterable[int]) -> SequenceWriter:
        """Give the writer of one sequence.

        Args:
            name: such as "EMO-1"; no `_`.
            motion: parameters of its timesteps as they shall be written.
            camera_indices: which cameras take an image at each timestep.

        Raises:
            DatasetError: the name would not do as a part of a folder's.
        """
        require_plain("sequence", name)
        return SequenceWriter(self, name, motion, tuple(camera_indices))

    def folder(self, sequence: str) -> Path:
        """Give the folder of a sequence."""
        return self.root / f"{self.subject}_{sequence}_{self.tag}"

    def finish(self, train: Sequence[SequenceWriter], test: Sequence[SequenceWriter]) -> Path:
        """Write the union folder: train and val from the first sequences (all cameras but one, and that one), test from the last.

        Args:
            train: finished sequences to train on, at least one.
            test: finished sequences held out, at least one.

        Returns:
            The union folder, which is what one trains on.

        Raises:
            DatasetError: no sequence to train on or none to test on.
            OSError: a file cannot be written.
        """
        if not train or not test:
            raise DatasetError(f"a union needs sequences to train and to test on, got {len(train)} and {len(test)}")
        names = [sequence.name for sequence in (*train, *test)]
        union = self.root / f"UNION{len(names)}_{self.subject}_{joined_names(names)}_{self.tag}"
        union.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self.folder(names[0]) / CANONICAL, union / CANONICAL)
        self.write_head(union)
        for kind, sequences in (("trainval", train), ("test", test)):
            with write_aside(union / f"sequences_{kind}.txt") as aside:
                aside.write_text("".join(f"{self.folder(s.name).name}\n" for s in sequences), encoding="utf-8")
        trainval, first = union_records(train, 0)
        held_out, _ = union_records(test, first)
        splits = {
            "train": [record for record in trainval if record.camera_index != self.validation_camera],
            "val": [record for record in trainval if record.camera_index == self.validation_camera],
            "test": held_out,
        }
        for split, records in splits.items():
            write_transforms(union / f"transforms_{split}.json", records)
        return union

    def write_head(self, folder: Path) -> None:
        """Write which head the parameters belong to."""
        if self.head is None:
            return
        file = None if self.head_file is None else Path(os.path.relpath(self.head_file, folder)).as_posix()
        entry = asdict(self.head) | {"file": file}
        with write_aside(folder / HEAD_JSON) as aside:
            aside.write_text(json.dumps(entry, indent=1), encoding="utf-8")


@dataclass
class SequenceWriter:
    """Writes one sequence's folder; `CaptureWriter.sequence` makes it.

    Args:
        capture: the capture that it belongs to.
        name: such as "EMO-1".
        motion: parameters of its timesteps.
        camera_indices: which cameras take an image at each timestep.
        records: frames added so far, by timestep and camera.
    """

    capture: CaptureWriter
    name: str
    motion: Motion
    camera_indices: tuple[int, ...]
    records: dict[tuple[int, int], FrameRecord] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where the sequence lies."""
        return self.capture.folder(self.name)

    @property
    def origin(self) -> dict[str, Any]:
        """What made the sequence: the capture's origin, and a digest of the motion."""
        digest = hashlib.sha256()
        for f in fields(self.motion):
            value = getattr(self.motion, f.name)
            if isinstance(value, np.ndarray):
                digest.update(np.ascontiguousarray(value, np.float32).tobytes())
        return {**self.capture.origin, "camera_indices": self.camera_indices, "motion_sha256": digest.hexdigest()}

    def is_complete(self) -> bool:
        """Whether the folder already holds this sequence, made from the same origin, to its last file."""
        path = self.folder / EVERYTHING
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (FileNotFoundError, ValueError):
            return False
        return bool(document.get("origin") == json.loads(json.dumps(self.origin)))

    def add(
        self,
        timestep: int,
        camera_index: int,
        camera: Camera,
        image: UInt8[np.ndarray, "h w 3"],
        mask: UInt8[np.ndarray, "_ _"],
    ) -> None:
        """Write one image and its mask; threads may call this at the same time.

        Args:
            timestep: frame of the sequence's motion.
            camera_index: which camera.
            camera: that camera, of the image's size.
            image: (h, w, 3) RGB on white.
            mask: (h, w) foreground, 255 inside.

        Raises:
            DatasetError: image, mask and camera disagree in size, or there is no such timestep or camera.
            OSError: a file cannot be written.
        """
        size = (camera.height, camera.width)
        if image.shape != (*size, 3) or mask.shape != size:
            raise DatasetError(f"{self.name}: image {image.shape} and mask {mask.shape} of a camera of (h, w) = {size}")
        if not (0 <= timestep < len(self.motion) and camera_index in self.camera_indices):
            raise DatasetError(
                f"{self.name}: no timestep {timestep}, camera {camera_index}; there are {len(self.motion)} timesteps, "
                f"cameras {self.camera_indices}"
            )
        if not self.records:
            (self.folder / EVERYTHING).unlink(missing_ok=True)  # from here on the folder is incomplete
        name = f"{timestep:05d}_{camera_index:02d}.png"
        for kind, pixels in (("images", image), ("fg_masks", mask)):
            with write_aside(self.folder / kind / name) as aside:
                Image.fromarray(pixels).save(aside, compress_level=PNG_LEVEL)
        self.records[timestep, camera_index] = FrameRecord(
            timestep,
            camera_index,
            f"{camera_index:02d}",
            camera,
            f"images/{name}",
            f"fg_masks/{name}",
            f"flame_param/{timestep:05d}.npz",
        )

    def finish(self) -> None:
        """Write parameters and transforms, the file that makes the sequence complete last.

        On its own the sequence is a capture too: the last tenth of its timesteps is `test`.

        Raises:
            DatasetError: an image was not added; the message names the first one.
            OSError: a file cannot be written.
        """
        n_timesteps = len(self.motion)
        for key in ((t, c) for t in range(n_timesteps) for c in self.camera_indices):
            if key not in self.records:
                raise DatasetError(f"{self.folder}: the image of timestep {key[0]}, camera {key[1]} was not added")
        for t in range(n_timesteps):
            write_flame_param(self.folder / "flame_param" / f"{t:05d}.npz", self.motion.frames(slice(t, t + 1)))
        write_flame_param(self.folder / CANONICAL, canonical(self.motion))
        self.capture.write_head(self.folder)
        records = [self.records[key] for key in sorted(self.records)]
        first_test = n_timesteps - max(1, round(TEST_FRACTION * n_timesteps)) if n_timesteps > 1 else 1
        training = [record for record in records if record.timestep < first_test]
        held_out = self.capture.validation_camera
        splits = {
            "train": [record for record in training if record.camera_index != held_out],
            "val": [record for record in training if record.camera_index == held_out],
            "test": [record for record in records if record.timestep >= first_test],
        }
        for split, chosen in splits.items():
            write_transforms(self.folder / f"transforms_{split}.json", chosen, single_sequence=True)
        write_transforms(self.folder / EVERYTHING, records, single_sequence=True, extra={"origin": self.origin})


def require_plain(kind: str, name: str) -> None:
    """Check that a name can be one of the parts of a folder's name, which `_` separates."""
    if not re.fullmatch(r"[A-Za-z0-9.-]+", name):
        raise DatasetError(f"{kind} {name!r}: expected letters, digits, '-' and '.'")


def canonical(motion: Motion) -> Motion:
    """Give the person at rest with the mouth a little open."""
    rest = Motion.rest(len(motion.shape), motion.expression.shape[1])
    jaw = np.array([[CANONICAL_JAW_RAD, 0, 0]], np.float32)
    return replace(rest, shape=motion.shape, static_offset=motion.static_offset, jaw=jaw, frame_rate=motion.frame_rate)


def union_records(sequences: Sequence[SequenceWriter], first: int) -> tuple[list[FrameRecord], int]:
    """Give the frames of finished sequences as a union names them, and the timestep after the last.

    Args:
        sequences: in the order of their timesteps.
        first: timestep of the first frame.
    """
    records = []
    for sequence in sequences:
        prefix = f"../{sequence.folder.name}/"
        records += [
            replace(
                record,
                timestep=first + record.timestep,
                file_path=prefix + record.file_path,
                fg_mask_path=None if record.fg_mask_path is None else prefix + record.fg_mask_path,
                flame_param_path=prefix + record.flame_param_path,
            )
            for record in read_transforms(sequence.folder / EVERYTHING)
        ]
        first += len(sequence.motion)
    return records, first


def joined_names(names: Sequence[str]) -> str:
    """Join sequences' names as NeRSemble's unions do: EMO-1, EMO-2, EXP-3, FREE gives EMO12EXP3FREE."""
    grouped: dict[str, str] = {}
    for name in names:
        kind, _, number = name.partition("-")
        grouped[kind] = grouped.get(kind, "") + number
    return "".join(kind + numbers for kind, numbers in grouped.items())
