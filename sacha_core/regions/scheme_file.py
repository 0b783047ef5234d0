"""Region schemes of one's own, as files: `NAME.scheme.npz` says of each triangle of one head which region it belongs to.

The file holds `version` (int32, 1), `name` (text), `regions` (r,) texts, `labels` (f,) integers below r, and, if regions are to have
colours of their own, `colours` (r, 3) uint8, sRGB. Without them they take the eight of the paper's scheme, in turn.
"""

from __future__ import annotations

import os

import numpy as np

from sacha_core.errors import FormatError, TopologyError
from sacha_core.flame.model import HeadModel
from sacha_core.npz import read_npz, write_npz
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER

__all__ = ["MOST_REGIONS", "read_scheme_file", "write_scheme_file"]

VERSION = 1
MOST_REGIONS = 64  # labels are bytes, and nobody reads a longer legend
LONGEST_NAME = 100
IN_OPTIONS = "=:"  # stand between a region's name and its numbers on the command line


def write_scheme_file(path: str | os.PathLike[str], partition: Partition) -> None:
    """Write a scheme file.

    Raises:
        OSError: it cannot be written.
    """
    write_npz(
        path,
        {
            "version": np.array(VERSION, np.int32),
            "name": np.array(partition.name),
            "regions": np.array(partition.regions),
            "colours": np.array(partition.colours, np.uint8),
            "labels": partition.labels,
        },
    )


def read_scheme_file(path: str | os.PathLike[str], head: HeadModel) -> Partition:
    """Read a scheme file for a head.

    Raises:
        FormatError: it is damaged or not a scheme file; the message says what was wrong and what was expected.
        TopologyError: its triangles are not as many as the head's.
        OSError: it cannot be read.
    """
    arrays = read_npz(path)
    if missing := [name for name in ("version", "name", "regions", "labels") if name not in arrays]:
        raise FormatError(f"{path}: not a scheme file: {missing[0]!r} is missing")
    version, labels = arrays["version"], arrays["labels"]
    if version.shape != () or version.dtype.kind not in "iu" or int(version) != VERSION:
        raise FormatError(f"{path}: not a scheme file of version {VERSION}")
    name = _texts(path, "name", arrays["name"].reshape(-1))[0] if arrays["name"].shape == () else ""
    regions = _texts(path, "regions", arrays["regions"])
    if not name or len(set(regions)) != len(regions) or not 1 <= len(regions) <= MOST_REGIONS:
        raise FormatError(f"{path}: expected a name and 1 to {MOST_REGIONS} regions of different names")
    if labels.ndim != 1 or labels.dtype.kind not in "iu":
        raise FormatError(
            f"{path}: labels are {labels.shape} of {labels.dtype}, expected one integer for each triangle"
        )
    if len(labels) != head.n_faces:
        raise TopologyError(f"{path} is of {len(labels)} triangles, but head {head.name!r} has {head.n_faces}")
    if labels.min(initial=0) < 0 or labels.max(initial=0) >= len(regions):
        raise FormatError(f"{path}: a label is outside 0 to {len(regions) - 1}, the places of its regions")
    return Partition(name, regions, _colours(path, arrays.get("colours"), len(regions)), labels.astype(np.uint8))


def _texts(path: str | os.PathLike[str], what: str, texts: np.ndarray) -> tuple[str, ...]:
    """Give names that can be printed, and typed as options."""
    if texts.ndim != 1 or texts.dtype.kind != "U":
        raise FormatError(f"{path}: {what} are {texts.shape} of {texts.dtype}, expected texts")
    for text in texts.tolist():
        if not 1 <= len(text) <= LONGEST_NAME or not text.isprintable() or set(text) & set(IN_OPTIONS):
            raise FormatError(
                f"{path}: {what} has {text[:LONGEST_NAME]!r}, expected at most {LONGEST_NAME} printable letters without = and :"
            )
    return tuple(texts.tolist())


def _colours(
    path: str | os.PathLike[str], given: np.ndarray | None, n_regions: int
) -> tuple[tuple[int, int, int], ...]:
    """Give the file's colours, or the paper's scheme's, from the first again where they do not reach."""
    if given is None:
        return tuple(PAPER.colours[place % len(PAPER.colours)] for place in range(n_regions))
    if given.shape != (n_regions, 3) or given.dtype != np.uint8:
        raise FormatError(f"{path}: colours are {given.shape} of {given.dtype}, expected ({n_regions}, 3) uint8")
    return tuple((int(red), int(green), int(blue)) for red, green, blue in given)
