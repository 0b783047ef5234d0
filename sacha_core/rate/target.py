"""Files of a wanted size or quality: the level that gives it, found by a few encodings.

Source: own; regula falsi inside a bracket.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from sacha_core.codec import decode
from sacha_core.codec.levels import MAX_QUALITY, MIN_QUALITY, Level, level_at
from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.progress import Progress, Report, silent
from sacha_core.rate.encoding import Encoded
from sacha_core.rate.judging import Judge

__all__ = ["Reached", "encode_to_psnr", "encode_to_size", "parse_size"]

START = 2.0
MOST_TRIALS = 8
NARROW = 0.01  # levels; sizes hardly differ within
LOG_BYTES_PER_LEVEL, DB_PER_LEVEL = 0.3, 5.5  # about, for the second trial
SIZE_TOLERANCE = 0.01  # of the size: a file may be this much smaller than it might
DB_TOLERANCE = 0.05  # and this much better
SURELY = 3.0  # times as many levels as a target that was just missed is away: how far the last trial goes
CHECKS = 3  # over all views, each of which takes as long as several encodings
UNITS = {"": 1, "b": 1, "kb": 1000, "mb": 1000**2, "kib": 1024, "mib": 1024**2}


@dataclass(frozen=True)
class Reached:
    """A file as near to a target as was found.

    Args:
        encoded: the file.
        psnr_db: what it reaches, over all views of the protocol; None where nobody measured it.
        n_trials: encodings that it took.
    """

    encoded: Encoded
    psnr_db: float | None
    n_trials: int


def parse_size(text: str) -> int:
    """Give the bytes that a size such as 300KB, 0.3 MB, 250KiB or 123456 names; KB are 1000 bytes.

    Raises:
        OptionError: it names none.
    """
    match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([a-z]*)\s*", text.lower())
    if match is None or match[2] not in UNITS or float(match[1]) * UNITS[match[2]] < 1:
        raise OptionError(f"a size of {text!r}, expected such as 300KB, 0.3MB or 250KiB")
    return int(float(match[1]) * UNITS[match[2]])


class Encoder(Protocol):
    """Whatever gives a file of an avatar bound to `head` at any level."""

    head: HeadModel

    def encode(self, level: Level) -> Encoded:
        """Encode at a level."""
        ...


def encode_to_size(
    encoder: Encoder, n_bytes: int, report: Report = silent, start: float = START, n_trials: int = MOST_TRIALS
) -> Reached:
    """Find the best file of at most so many bytes, motion and all included: from a quality `start` on, see `search`.

    Raises:
        OptionError: even the smallest file is larger; the message says how large.
    """
    trials = Trials(encoder, report, n_trials)

    def size(quality: float) -> float:
        return math.log(len(trials.at(quality).data))

    tried = search(size, math.log(n_bytes), LOG_BYTES_PER_LEVEL, -SIZE_TOLERANCE, start, n_trials)
    fitting = [quality for quality in tried if len(trials.at(quality).data) <= n_bytes]
    if not fitting:
        smallest = min(len(trials.at(quality).data) for quality in tried)
        raise OptionError(
            f"a file of {n_bytes:,} bytes is out of reach; the smallest of this avatar takes {smallest:,}"
        )
    return Reached(trials.at(max(fitting)), None, len(trials))


def encode_to_psnr(
    encoder: Encoder,
    judge: Judge,
    decibels: float,
    report: Report = silent,
    start: float = START,
    n_trials: int = MOST_TRIALS,
    grain_db: float = 0.0,
) -> Reached:
    """Find the smallest file that reaches a PSNR against the uncompressed avatar, over all views of the protocol.

    Searches by an eighth of the views, from a quality `start` on (see `search`), then holds what it found to all of them and corrects
    itself, twice at most. Files of neighbouring qualities may differ by `grain_db` by chance: where all that was tried fell short, the
    last one is tried so far beyond.

    Raises:
        OptionError: even the best file does not reach it; the message says how far it comes.
    """
    if not 0 < decibels < math.inf:
        raise OptionError(f"a target of {decibels:g} dB, expected a finite number above 0")
    trials, offset, checked = Trials(encoder, report, n_trials), 0.0, dict[float, float]()
    head = encoder.head

    def quick(quality: float) -> float:
        return judge.quick(decode(trials.at(quality).data, head=head).gaussians)

    for _ in range(CHECKS):
        tried = search(quick, decibels - offset, DB_PER_LEVEL, DB_TOLERANCE, start, n_trials)
        fitting = [quality for quality, found in tried.items() if found >= decibels - offset]
        start = min(fitting, key=lambda quality: (len(trials.at(quality).data), quality), default=max(tried))
        if start not in checked:
            checked[start] = judge.full(decode(trials.at(start).data, head=head).gaussians)
        offset = checked[start] - tried[start]
        if not fitting or 0 <= checked[start] - decibels <= 2 * DB_TOLERANCE:
            break
    reached = [quality for quality, found in checked.items() if found >= decibels]
    if not reached:
        best = max(checked, key=lambda quality: checked[quality])
        if best < MAX_QUALITY - NARROW:  # so near that all checks were spent
            beyond = (decibels - checked[best] + grain_db) / DB_PER_LEVEL if grain_db else 0.0
            top = trials.at(round(min(best + 2 * NARROW + beyond, MAX_QUALITY), 4))
            full = judge.full(decode(top.data, head=head).gaussians)
            if full >= decibels:
                return Reached(top, full, len(trials))
        raise OptionError(
            f"{decibels:g} dB are out of reach; the best file of this avatar has {checked[best]:.2f} dB at"
            f" {len(trials.at(best).data):,} bytes (level archive keeps every bit)"
        )
    smallest = min(reached, key=lambda quality: len(trials.at(quality).data))
    return Reached(trials.at(smallest), checked[smallest], len(trials))


class Trials:
    """Encodings by quality, each made once.

    Args:
        encoder: makes them.
        report: told about each.
        expected: how many they will be, about.
    """

    def __init__(self, encoder: Encoder, report: Report, expected: int) -> None:
        self._encoder, self._report, self._expected = encoder, report, expected
        self._made: dict[float, Encoded] = {}

    def __len__(self) -> int:
        """Give the number of encodings made."""
        return len(self._made)

    def at(self, quality: float) -> Encoded:
        """Give the file at a quality."""
        if quality not in self._made:
            self._made[quality] = self._encoder.encode(level_at(quality))
            self._report(Progress("search", len(self._made), max(len(self._made), self._expected)))
        return self._made[quality]


def search(
    measure: Callable[[float], float],
    target: float,
    slope: float,
    tolerance: float,
    start: float = START,
    n_trials: int = MOST_TRIALS,
) -> dict[float, float]:
    """Measure at a few qualities, each nearer to the target, until one is within the tolerance on its side.

    Args:
        measure: rises with quality.
        target: wanted of it.
        slope: about how much it rises in a level.
        tolerance: positive if the target shall be reached and may be exceeded by so much, negative if it shall not be exceeded.
        start: where to begin.
        n_trials: measurements, at most, and one more where none is on the right side, far enough off to be there in all likelihood.

    Returns:
        What was measured, by quality.
    """
    tried: dict[float, float] = {}
    usual = slope
    low, high, quality = MIN_QUALITY, MAX_QUALITY, start
    aim = target + tolerance / 2
    for _ in range(n_trials):
        quality = round(quality, 4)
        off = tried.setdefault(quality, measure(quality)) - target
        if 0 <= off * math.copysign(1, tolerance) <= abs(tolerance):
            break
        low, high = (low, quality) if off > 0 else (quality, high)
        if high - low < NARROW:
            break
        if low in tried and high in tried:
            part = (aim - tried[low]) / max(tried[high] - tried[low], 1e-9)
            quality = low + min(max(part, 0.1), 0.9) * (high - low)
        else:
            if len(tried) > 1:
                (first, before), (second, after) = list(tried.items())[-2:]
                slope = max((after - before) / (second - first), slope / 4)
            quality = min(max(quality + (aim - tried[quality]) / slope, low), high)
    side = math.copysign(1, tolerance)
    nearest = max(tried, key=lambda one: side * tried[one])
    missing = target - tried[nearest]
    if side * missing > 0:
        quality = nearest + SURELY * missing / usual + side * NARROW
        quality = round(min(max(quality, MIN_QUALITY), MAX_QUALITY), 4)
        if quality not in tried:
            tried[quality] = measure(quality)
    return tried
