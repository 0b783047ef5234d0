"""From numbers to colours: which row of a palette each number gets, and the round numbers that a legend shows.

Source: own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, Real

from sacha_core.scene.palettes import DIVERGING, MAGNITUDE, STEPS

__all__ = ["Kind", "Scale", "number_text", "scale_of"]

Kind = Literal["amount", "level", "factor", "change"]
"""amount: from 0, heavy-tailed, on a logarithmic ramp; level: evenly from the least to the largest; factor: around 1, as far up as down;
change: around 0, finely near it and coarsely far away."""

RANGE = 100.0  # an amount below the end of the ramp over this gets the lightest colour: two decades are what eyes tell apart on a ramp
MANY_NUMBERS = 200  # of as many, a few lie far from all others, and would take the ramp for themselves
OUTSIDE = 1.0  # percent of these at either end, which get the colour of the end
NEAR = 100.0  # changes below the largest over this are shown evenly
ROUND = (1.0, 2.0, 5.0)
MANY = 9  # lines that a legend may have before it keeps to powers of ten
TICKS = 5  # lines of a legend of levels, about
SMALLEST_FACTOR = 1.01  # a scale of factors that are all 1 still has two sides


@dataclass(frozen=True)
class Scale:
    """How numbers become rows of a palette.

    Args:
        palette: its name.
        place: gives the place of finite numbers along the ramp, 0 to 1; NaN for what has the colour of none.
        ticks: numbers of the legend, from top to bottom.
        whole: whether the numbers are whole ones.
        lowest: of all numbers; below the first tick where the ramp begins later.
        highest: of all numbers; above the last tick where the ramp ends sooner.
    """

    palette: str
    place: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]
    ticks: list[float]
    whole: bool
    lowest: float = -np.inf
    highest: float = np.inf

    def labels(self, *, signed: bool = False) -> list[str]:
        """Give the ticks as people read them; those at the ends say how far numbers go beyond."""

        def text(value: float) -> str:
            return f"+{number_text(value, self.whole)}" if signed and value > 0 else number_text(value, self.whole)

        found = [text(tick) for tick in self.ticks]
        first = next((place for place, tick in enumerate(self.ticks) if tick != 0), 0)
        if np.isfinite(self.lowest) and self.lowest < self.ticks[first]:
            found[first] = f"{found[first]} and less, to {text(self.lowest)}"
        if np.isfinite(self.highest) and self.highest > self.ticks[-1]:
            found[-1] = f"{found[-1]} and more, to {text(self.highest)}"
        return found

    def levels(self, values: Real[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Give the row of each number."""
        wide = values.astype(np.float64)
        known = np.isfinite(wide)
        place = np.where(known, self.place(np.where(known, wide, 0.0)), np.nan)
        shown = np.isfinite(place)
        rows = 1 + np.rint(np.clip(np.where(shown, place, 0.0), 0, 1) * (STEPS - 1)).astype(np.int32)
        return np.where(shown, rows, 0).astype(np.int32)


def scale_of(values: Real[np.ndarray, " n"], kind: Kind) -> Scale:
    """Choose the scale on which all of these numbers can be shown; NaN counts for nothing."""
    whole = bool(np.issubdtype(values.dtype, np.integer))
    known = values[np.isfinite(values)].astype(np.float64)
    if kind == "amount":
        return _amount(known, whole)
    if kind == "level":
        return _level(known, whole)
    return _factor(known) if kind == "factor" else _change(known, whole)


def number_text(value: float, whole: bool) -> str:
    """Write a number for people: whole ones in full, others to three digits."""
    if not np.isfinite(value):
        return "-"
    if whole:
        return f"{round(value):,}"
    digits = 3 if value == 0 else max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.2e}" if digits > 5 else f"{value:,.{digits}f}"


def _amount(known: Float[np.ndarray, " n"], whole: bool) -> Scale:
    positive = known[known > 0]
    low, high = _ends(positive, whole)
    span = np.log(high / low)

    def place(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        along = np.log(np.maximum(values, low) / low) / (span or 1.0)
        return np.asarray(np.where(values > 0, along, np.nan))

    if not len(positive):
        return Scale(MAGNITUDE, place, [0.0], whole)
    between = [tick for tick in _round_numbers(low, high) if low < tick < high]
    zero = [0.0] if len(positive) < len(known) else []
    ticks = sorted({*zero, low, *between, high})
    return Scale(MAGNITUDE, place, ticks, whole, float(positive.min()), float(positive.max()))


def _ends(positive: Float[np.ndarray, " n"], whole: bool) -> tuple[float, float]:
    """Give where a ramp begins and ends: of whole numbers and of few ones at the least and the largest, of others without the outermost."""
    if not len(positive):
        return 1.0, 1.0
    outside = 0.0 if whole or len(positive) < MANY_NUMBERS else OUTSIDE
    low, high = np.percentile(positive, [outside, 100 - outside]).tolist()
    return (low if whole else max(low, high / RANGE)), high


def _level(known: Float[np.ndarray, " n"], whole: bool) -> Scale:
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    span = high - low

    def place(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        return np.asarray((values - low) / (span or 1.0))

    step = _round_step(span / TICKS) if span > 0 else 0.0
    inner = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step if step > 0 else np.zeros(0)
    margin = span / TICKS / 2  # what is nearer to an end than this would stand on its line
    ticks = [low, *inner[(inner > low + margin) & (inner < high - margin)].tolist(), high]
    return Scale(MAGNITUDE, place, sorted(set(ticks)), whole)


def _factor(known: Float[np.ndarray, " n"]) -> Scale:
    positive = known[known > 0]
    most = max(float(np.exp(np.abs(np.log(positive)).max(initial=0.0))), SMALLEST_FACTOR)

    def place(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        return np.asarray(0.5 + 0.5 * np.log(np.maximum(values, 1 / most)) / np.log(most))

    return Scale(DIVERGING, place, [1 / most, most**-0.5, 1.0, most**0.5, most], whole=False)


def _change(known: Float[np.ndarray, " n"], whole: bool) -> Scale:
    size = np.abs(known[known != 0])
    most = _ends(size, whole)[1]
    near = 1.0 if whole else most / NEAR

    def place(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        return np.asarray(0.5 + 0.5 * np.sign(values) * np.log1p(np.abs(values) / near) / np.log1p(most / near))

    if not len(size):
        return Scale(DIVERGING, place, [0.0], whole)
    tens = [tick for tick in _powers_of_ten(near, most) if tick < most]
    ticks = [-most, *(-tick for tick in reversed(tens)), 0.0, *tens, most]
    return Scale(DIVERGING, place, ticks, whole, min(float(known.min()), -most), max(float(known.max()), most))


def _powers_of_ten(low: float, high: float) -> list[float]:
    """Powers of ten from `low` to `high`."""
    first, last = (int(np.floor(np.log10(bound))) for bound in (low, high))
    return [10.0**power for power in range(first, last + 1) if low <= 10.0**power <= high]


def _round_numbers(low: float, high: float) -> list[float]:
    """Ones, twos and fives of every decade from `low` to `high`; of many, ones only."""
    if not 0 < low <= high:
        return []
    decades = range(int(np.floor(np.log10(low))), int(np.floor(np.log10(high))) + 1)
    numbers = [digit * 10.0**power for power in decades for digit in ROUND if low <= digit * 10.0**power <= high]
    return numbers if len(numbers) <= MANY else _powers_of_ten(low, high)


def _round_step(least: float) -> float:
    """Give the next one, two or five of a decade."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(digit * power for digit in (*ROUND, 10.0) if digit * power >= least * (1 - 1e-9)))
