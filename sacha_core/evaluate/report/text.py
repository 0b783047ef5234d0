"""Figures as a reader wants them: a mean, its spread over the seeds, and what is missing."""

from __future__ import annotations

import math

from sacha_core.evaluate.report.entry import Entry

__all__ = ["DECIMALS", "MISSING", "difference", "number", "value"]

MISSING = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"
DECIMALS = {
    "psnr": 2, "ssim": 4, "flip": 4, "lpips_vgg": 4, "lpips_alex": 4, "Gaussians": 0, "visible Gaussians": 0, "empty faces": 0,
    "hidden share": 1, "training time": 0, "percent": 1, "modulator": 2,
}  # fmt: skip


def number(figure: float, decimals: int, signed: bool = False) -> str:
    """Set a figure with thousands apart, a true minus and, where signed, a plus; nothing known is a dash."""
    if math.isnan(figure):
        return MISSING
    text = f"{figure:{'+' if signed else ''},.{decimals}f}"
    if not any(digit in text for digit in "123456789"):
        text = text.lstrip("+-")  # neither +0.00 nor -0.00 tells anything
    return text.replace("-", MINUS)


def value(entry: Entry | None, decimals: int, per: float = 1.0) -> str:
    """Set mean and spread of a variant's own figure; with how many of the seeds have it where some lack it.

    Args:
        entry: the figure; None gives a dash.
        decimals: after the point.
        per: what the figure is divided by, such as 1000 for thousands.
    """
    if entry is None or not entry.n_seeds:
        return MISSING
    return _mean_and_spread(entry, decimals, per, signed=False) + _how_many(entry)


def difference(entry: Entry | None, decimals: int, per: float = 1.0) -> str:
    """Set mean and spread of paired differences, and how many of the pairs are positive; arguments as of `value`."""
    if entry is None or not entry.n_seeds:
        return MISSING
    percent = " %" if entry.unit == "%" else ""
    return f"{_mean_and_spread(entry, decimals, per, signed=True)}{percent} ({entry.n_positive}/{entry.n_seeds}){_how_many(entry)}"


def _mean_and_spread(entry: Entry, decimals: int, per: float, signed: bool) -> str:
    mean = number(entry.mean / per, decimals, signed)
    return mean if entry.n_seeds < 2 else f"{mean} ± {number(entry.sd / per, decimals)}"


def _how_many(entry: Entry) -> str:
    """Tell of seeds that lack the figure."""
    lacking = len(entry.seeds.missing)
    return f" [{entry.n_seeds} of {entry.n_seeds + lacking} seeds]" if lacking else ""
