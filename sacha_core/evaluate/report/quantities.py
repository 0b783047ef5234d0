"""What is read off one result: the quantities of tables, by name and unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sacha_core.evaluate.ablation.result import Quality, RunResult

__all__ = ["COUNTS", "PICTURE", "REGION_METRICS", "Count", "picture_value", "size_bytes"]


@dataclass(frozen=True)
class Count:
    """A figure of a run in which pictures play no part.

    Args:
        unit: of its values.
        read: from a result to the value; None where it has none.
        relative: whether two variants are compared by percent.
    """

    unit: str
    read: Callable[[RunResult], float | None]
    relative: bool


COUNTS: Mapping[str, Count] = {
    "Gaussians": Count("", lambda result: result.n, relative=True),
    "visible Gaussians": Count("", lambda result: result.n_visible, relative=True),
    "hidden share": Count(
        "%", lambda result: 100 * (1 - result.n_visible / result.n) if result.n else None, relative=False
    ),
    "empty faces": Count("", lambda result: result.empty_faces, relative=False),
    "training time": Count("s", lambda result: result.training_seconds, relative=True),
}
# Measures of a picture, with the unit of their values
PICTURE = {"psnr": "dB", "ssim": "", "flip": "", "lpips_vgg": "", "lpips_alex": ""}
REGION_METRICS = ("psnr", "flip")  # that are measured within regions as well


def picture_value(quality: Quality | None, metric: str, region: str | None = None) -> float | None:
    """Give one measure of the picture, of the whole or of a region; None where it was not measured."""
    if quality is None:
        return None
    if region is None:
        value: float | None = getattr(quality, metric)
        return value
    part = quality.regions.get(region)
    return None if part is None or metric not in REGION_METRICS else getattr(part, metric)


def size_bytes(result: RunResult, level: int) -> int | None:
    """Give the bytes of a run's Gaussians at a level, 0 for uncompressed; None where it was not coded."""
    point = result.point(level)
    return None if point is None else point.bytes.gaussians
