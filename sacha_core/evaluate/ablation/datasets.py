"""The captures of an ablation: which they are, and their heads, kept beside their runs."""

from __future__ import annotations

import json
import os
from pathlib import Path

from sacha_core.errors import DatasetError, FormatError
from sacha_core.evaluate.ablation.plan import HEAD, Dataset
from sacha_core.files import write_aside
from sacha_core.flame.head_file import load_head, save_head
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture
from sacha_core.train.loop import require_head

__all__ = ["keep_dataset", "known_datasets"]

RECORD = "dataset.json"


def keep_dataset(out: Path, root: str | os.PathLike[str], capture: Capture, head: HeadModel) -> Dataset:
    """Note a capture in an ablation's folder, with its head, which workers elsewhere could not find.

    Args:
        out: the ablation's folder.
        root: what the user called the capture; the folder's name becomes the dataset's.
        capture: what lies there.
        head: that it was tracked with.

    Raises:
        DatasetError: nothing is held out to judge by, or another capture has the same name.
        HeadError: the head is another one.
        OSError: the folder cannot be written.
    """
    place = Path(root).resolve()
    dataset = Dataset(place.name, place, out / place.name / HEAD)
    for views, what in ((capture.val, "camera"), (capture.test, "timesteps")):
        if not views:
            raise DatasetError(f"{capture.root} has no held-out {what} to judge by")
    require_head(capture, head)
    record = out / dataset.name / RECORD
    if record.is_file() and (before := _read(record)) != place and before.is_dir():
        raise DatasetError(f"{out / dataset.name} is of the capture {before}, not of {place}; choose another folder")
    if not dataset.head.is_file() or load_head(dataset.head).reference != head.reference or head.masks:
        save_head(head, dataset.head)
    with write_aside(record) as aside:
        aside.write_text(json.dumps({"root": str(place)}) + "\n", encoding="utf-8")
    return dataset


def known_datasets(out: Path) -> tuple[Dataset, ...]:
    """Give the captures that an ablation's folder knows and that are still there.

    Raises:
        FormatError: a record is damaged.
    """
    places = [(record, _read(record)) for record in sorted(out.glob(f"*/{RECORD}"))]
    return tuple(Dataset(record.parent.name, root, record.parent / HEAD) for record, root in places if root.is_dir())


def _read(record: Path) -> Path:
    try:
        return Path(json.loads(record.read_bytes())["root"])
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{record} does not name a capture") from error
