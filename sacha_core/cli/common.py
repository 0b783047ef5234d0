"""Options that several commands share, and how they are checked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Optional

import tyro

from sacha_core.errors import FormatError, OptionError

__all__ = [
    "Common",
    "FileOption",
    "HeadSource",
    "ImageSize",
    "MaybeFloat",
    "MaybeInt",
    "MaybePath",
    "MaybeText",
    "PixelsOption",
    "naming",
    "require_both_sides",
    "require_size",
]

# `Optional` is what tyro understands by itself; for `X | None` it imports typeguard, which takes longer than the rest of `--help`.
MaybePath = Optional[Path]  # noqa: UP045
MaybeInt = Optional[int]  # noqa: UP045
MaybeFloat = Optional[float]  # noqa: UP045
MaybeText = Optional[str]  # noqa: UP045
FileOption = Annotated[MaybePath, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
PixelsOption = Annotated[MaybeInt, tyro.conf.arg(metavar="PIXELS", help_behavior_hint="")]
LARGEST_SIDE = 16_384  # a picture of that many pixels each way takes some gigabytes already


@dataclass(frozen=True)
class Common:
    """What every command takes."""

    json: FileOption = None
    """Also write a machine-readable report to this file."""

    progress: Literal["bar", "json", "none"] = "bar"
    """bar: with the time left; json: one object a line on stdout, and nothing else there; none."""


@dataclass(frozen=True)
class HeadSource:
    """The head that the avatar is bound to."""

    head: Annotated[MaybeText, tyro.conf.arg(metavar="HEAD", help_behavior_hint="")] = None
    """A head model or rig (.npz), a FLAME pickle, or "synthetic"; by default the one inside the file, else the one used before."""

    masks: FileOption = None
    """Vertex masks (FLAME_masks.npz or .pkl), which tell the regions of a head apart that brings none."""


@dataclass(frozen=True)
class ImageSize:
    """How large images are."""

    width: PixelsOption = None
    """Image width; by default the stored one."""

    height: PixelsOption = None
    """Image height; by default the stored one."""


def require_size(**sides: int | None) -> None:
    """Check the sides of an image that were given on the command line.

    Raises:
        OptionError: naming the first that is out of range.
    """
    for name, pixels in sides.items():
        if pixels is not None and not 1 <= pixels <= LARGEST_SIDE:
            raise OptionError(f"--{name} is {pixels}, expected 1 to {LARGEST_SIDE} pixels")


def require_both_sides(width: int | None, height: int | None) -> None:
    """Check that a capture's images are resized along both sides or not at all, since one alone would squeeze them.

    Raises:
        OptionError: only one is given.
    """
    if (width is None) != (height is None):
        given, missing = ("--width", "--height") if height is None else ("--height", "--width")
        raise OptionError(f"{given} without {missing} would squeeze the capture's images; give both or neither")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of the file before what is wrong with it."""
    try:
        yield
    except FormatError as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error
