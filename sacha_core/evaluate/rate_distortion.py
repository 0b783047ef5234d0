"""Comparing rate-distortion curves: bytes at equal quality, quality at equal bytes, and both on average (Bjøntegaard's deltas)."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

__all__ = ["Curve", "Interpolated", "bd_quality", "bd_rate", "bytes_at", "common_quality", "quality_at", "rd_curve"]


@dataclass(frozen=True)
class Curve:
    """What quality takes how many bytes: points of which each larger one is better than all smaller ones.

    Args:
        n_bytes: ascending.
        quality: as far as the points reach, strictly better from one to the next.
        lower_is_better: as with FLIP and LPIPS.
        dropped: (bytes, quality) of points that were left out because another one is as good at no more bytes.
    """

    n_bytes: tuple[float, ...]
    quality: tuple[float, ...]
    lower_is_better: bool = False
    dropped: tuple[tuple[float, float], ...] = ()

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest quality."""
        return min(self.quality), max(self.quality)


@dataclass(frozen=True)
class Interpolated:
    """A figure between measured points, or why there is none.

    Args:
        value: None where the curves do not reach.
        reason: why there is no value; empty where there is one.
        overlap: of two curves, the share of the range of both together that both cover; a small one is little to go by.
    """

    value: float | None
    reason: str = ""
    overlap: float = 1.0


def rd_curve(points: Iterable[tuple[float | int, float | int]], lower_is_better: bool = False) -> Curve:
    """Make a curve of measured points.

    A point that takes at least as many bytes as another one without being better is left out and listed as dropped: nobody would use it,
    and no curve through it has one size for one quality.

    Args:
        points: bytes and quality of each, in any order.
        lower_is_better: as with FLIP and LPIPS.

    Raises:
        ValueError: there are no points, or one has no bytes or a quality that is not finite.
    """
    sign = -1 if lower_is_better else 1
    ordered = sorted(((float(size), float(quality)) for size, quality in points), key=lambda p: (p[0], -sign * p[1]))
    if not ordered:
        raise ValueError("a rate-distortion curve needs points, and there are none")
    kept: list[tuple[float, float]] = []
    dropped: list[tuple[float, float]] = []
    for size, quality in ordered:
        if not (math.isfinite(size) and size > 0 and math.isfinite(quality)):
            raise ValueError(f"a point of {size} bytes and quality {quality} cannot lie on a rate-distortion curve")
        better = not kept or sign * quality > sign * kept[-1][1]
        (kept if better else dropped).append((size, quality))
    sizes, qualities = zip(*kept, strict=True)
    return Curve(sizes, qualities, lower_is_better, tuple(dropped))


def bytes_at(curve: Curve, quality: float) -> Interpolated:
    """Say how many bytes a quality takes, between the points of a curve only.

    Args:
        curve: with two points or more.
        quality: in the curve's units.

    Source: as `bd_rate`.
    """
    low, high = curve.range
    lacking = missing(curve)
    if lacking:
        return Interpolated(None, lacking)
    if not low <= quality <= high:
        return Interpolated(None, f"quality {quality:g} is outside what was measured, {low:g} to {high:g}")
    return Interpolated(10 ** float(log_bytes_of(curve)(quality)))


def quality_at(curve: Curve, n_bytes: float) -> Interpolated:
    """Say which quality a number of bytes buys, between the points of a curve only.

    Args:
        curve: with two points or more.
        n_bytes: how many.

    Source: as `bd_quality`.
    """
    low, high = curve.n_bytes[0], curve.n_bytes[-1]
    lacking = missing(curve)
    if lacking:
        return Interpolated(None, lacking)
    if not low <= n_bytes <= high:
        return Interpolated(None, f"{n_bytes:,.0f} bytes are outside what was measured, {low:,.0f} to {high:,.0f}")
    return Interpolated(float(quality_of(curve)(math.log10(n_bytes))))


def bd_rate(anchor: Curve, test: Curve) -> Interpolated:
    """Say how many percent more bytes `test` takes at equal quality, on average over the quality that both reach; negative is fewer.

    Args:
        anchor: compared with.
        test: compared.

    Returns:
        Percent: mean of the difference of the logarithms of bytes, as a ratio, less one.

    Source: Bjøntegaard, VCEG-M33, 2001, with monotone cubic interpolation (Fritsch and Butland's) as in JCTVC-L1100.
    """
    found = mean_gap(anchor, test, "quality", log_bytes_of, anchor.range, test.range)
    return found if found.value is None else Interpolated(100 * (10**found.value - 1), "", found.overlap)


def bd_quality(anchor: Curve, test: Curve) -> Interpolated:
    """Say how much quality `test` has more than `anchor` at equal bytes, on average over the logarithm of the bytes that both take.

    Args:
        anchor: compared with.
        test: compared.

    Returns:
        In units of the quality: dB for PSNR (BD-PSNR). For FLIP and LPIPS a negative figure is the better one.

    Source: as `bd_rate`.
    """
    first, second = ((math.log10(curve.n_bytes[0]), math.log10(curve.n_bytes[-1])) for curve in (anchor, test))
    return mean_gap(anchor, test, "size", quality_of, first, second)


def common_quality(curves: Iterable[Curve]) -> tuple[float, float] | None:
    """Give the lowest and highest quality that all curves reach; None where there is none."""
    ranges = [curve.range for curve in curves]
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    return (low, high) if low <= high else None


def missing(*curves: Curve) -> str:
    """Say why nothing can be interpolated; nothing where it can."""
    if min(len(curve.quality) for curve in curves) < 2:
        return "two points of different quality or more are needed"
    if importlib.util.find_spec("scipy") is None:
        return "curves need the package scipy: python -m pip install scipy"
    return ""


def mean_gap(
    anchor: Curve,
    test: Curve,
    axis: str,
    interpolated: Callable[[Curve], Any],
    first: tuple[float, float],
    second: tuple[float, float],
) -> Interpolated:
    """Average how far `test` lies above `anchor` over the part of the axis that both cover; `first` and `second` are what each does."""
    lacking = missing(anchor, test)
    if lacking:
        return Interpolated(None, lacking, 0.0)
    low, high = max(first[0], second[0]), min(first[1], second[1])
    if low >= high:
        return Interpolated(None, f"the curves have no {axis} in common", 0.0)
    areas = [interpolated(curve).integrate(low, high) for curve in (anchor, test)]
    overlap = (high - low) / (max(first[1], second[1]) - min(first[0], second[0]))
    return Interpolated(float(areas[1] - areas[0]) / (high - low), "", overlap)


def log_bytes_of(curve: Curve) -> Any:
    """Interpolate the decimal logarithm of bytes over quality."""
    sizes = [math.log10(size) for size in curve.n_bytes]
    pairs = sorted(zip(curve.quality, sizes, strict=True))
    return monotone(*zip(*pairs, strict=True))


def quality_of(curve: Curve) -> Any:
    """Interpolate quality over the decimal logarithm of bytes."""
    return monotone([math.log10(size) for size in curve.n_bytes], curve.quality)


def monotone(x: Any, y: Any) -> Any:
    """Interpolate by cubics that are monotone wherever the points are."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 - takes as long to load as all of NumPy

    return PchipInterpolator(x, y)
