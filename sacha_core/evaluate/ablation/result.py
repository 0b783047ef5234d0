"""What one run of an ablation came to: its Gaussians, its bytes, and what is left of the picture at each level."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sacha_core.errors import FormatError
from sacha_core.evaluate.ablation.record import read_record
from sacha_core.evaluate.picture_metrics import Quality, RegionQuality
from sacha_core.files import write_aside

__all__ = [
    "RESULT", "UNCOMPRESSED", "Point", "Quality", "RegionQuality", "RegionResult", "RunResult", "SizeBytes", "read_result", "write_result",
]  # fmt: skip

RESULT = "result.json"
UNCOMPRESSED = 0  # the level of a point that was not coded
LARGEST_FILE = 16 << 20  # a result takes some ten kilobytes


@dataclass(frozen=True)
class SizeBytes:
    """What a point takes, without the head.

    Args:
        gaussians: all that describes the Gaussians.
        motion: all frames.
        total: both.
    """

    gaussians: int
    motion: int
    total: int


@dataclass(frozen=True)
class Point:
    """One level of one run.

    Args:
        level: of the codec, 1 to 4; `UNCOMPRESSED` (0) for the trained avatar itself, at 252 bytes a Gaussian.
        n: Gaussians in the file.
        bytes: what it takes.
        encode_s: seconds that encoding took; 0 uncompressed.
        decode_s: seconds that decoding took.
        novel_view: by the held-out camera.
        novel_expression: at held-out timesteps.
    """

    level: int
    n: int
    bytes: SizeBytes
    encode_s: float
    decode_s: float
    novel_view: Quality
    novel_expression: Quality


@dataclass(frozen=True)
class RegionResult:
    """What became of one region's Gaussians.

    Args:
        n: how many there are at the end.
        n_visible: those that training views show.
        n_before: how many there were before the first pruning; None where only densification removed any.
        modulator_first: m_R at the first calibration; None where the region had no mean.
        modulator_last: at the last.
        threshold: tau_R at the end.
        ratio: rho_R at the end, 0 without pruning by score.
    """

    n: int
    n_visible: int
    n_before: int | None
    modulator_first: float | None
    modulator_last: float | None
    threshold: float
    ratio: float


@dataclass(frozen=True)
class RunResult:
    """One variant, trained on one capture with one seed.

    Args:
        dataset: name of the capture.
        variant: name of the variant.
        seed: of the training.
        iterations: of the training.
        n: Gaussians at the end.
        n_visible: those that training views show.
        empty_faces: triangles without a Gaussian.
        training_seconds: that training took, warm-up included.
        regions: by region name.
        points: uncompressed, and at each level.
    """

    dataset: str
    variant: str
    seed: int
    iterations: int
    n: int
    n_visible: int
    empty_faces: int
    training_seconds: float
    regions: Mapping[str, RegionResult]
    points: tuple[Point, ...]

    def point(self, level: int) -> Point | None:
        """Give the point of a level, if it was measured."""
        return next((point for point in self.points if point.level == level), None)

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, record: Any, where: str = "result") -> RunResult:
        """Build a result from what `to_json` gave.

        Args:
            record: plain values.
            where: what errors call it.

        Raises:
            FormatError: naming the field that is missing, unknown, or of another type.
        """
        return read_record(cls, record, where)


def read_result(path: str | os.PathLike[str]) -> RunResult:
    """Read a run's result.

    Raises:
        FormatError: the file is no result; the message names file and field.
        OSError: it cannot be read.
    """
    file = Path(path)
    if file.stat().st_size > LARGEST_FILE:
        raise FormatError(f"{file} has {file.stat().st_size} bytes, expected a result of at most {LARGEST_FILE}")
    try:
        record = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{file} is not JSON: {error}") from error
    return RunResult.from_json(record, str(file))


def write_result(path: str | os.PathLike[str], result: RunResult) -> None:
    """Write a run's result, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(result.to_json(), indent=2, allow_nan=False)
    with write_aside(path) as aside:
        aside.write_text(text + "\n", encoding="utf-8")
