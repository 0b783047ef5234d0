"""The benches there are, and where each one lives."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Protocol, cast

from sacha_core.bench.preset import Preset
from sacha_core.bench.result import Bench
from sacha_core.errors import OptionError
from sacha_core.progress import Report

__all__ = ["BENCHES", "BenchModule", "Place", "load"]


@dataclass(frozen=True)
class Place:
    """Where a bench lives.

    Args:
        module: its module or package in this folder.
        summary: what it measures, in a line.
        drawn: whether there is a picture of it.
    """

    module: str
    summary: str
    drawn: bool = True


class BenchModule(Protocol):
    """What the module of a bench offers."""

    TITLE: str

    def measure(self, preset: Preset, report: Report) -> Bench:
        """Measure everything, telling `report` where that stands."""


BENCHES = {
    "raster": Place("raster", "Drawing Gaussians, forward and backward: time and error."),
    "posing": Place("posing", "Posing the head in float32 and float64."),
    "playback": Place("playback", "Opening and playing a .sacha file."),
    "codec": Place("codec", "Levels of compression: time, bytes, PSNR."),
    "motion": Place("motion", "Frames of a motion: bytes against vertex error, in files and in packets."),
    "train": Place("train", "Training: budget against quality, and what an iteration costs."),
    "stability": Place("stability", "Hard cases, each with what must happen."),
    "skips": Place("skips", "What is skipped, what that saves, and its proof.", drawn=False),
    "cuda": Place("cuda", "The CUDA engine against the CPU's; needs a device."),
}


def load(name: str) -> BenchModule:
    """Give the module of a bench.

    Raises:
        OptionError: there is no such bench, or a package is missing that it compares with.
    """
    if name not in BENCHES:
        raise OptionError(f"there is no bench {name!r}; expected one of {', '.join(BENCHES)}")
    try:
        return cast("BenchModule", importlib.import_module(f"{__package__}.{BENCHES[name].module}"))
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise OptionError(f"bench {name} needs the package torch: pip install 'sacha[bench]'") from error
