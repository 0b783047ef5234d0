"""What a file shall be, as good as another or of a size, and what some Gaussians promise towards it before they are fitted to it.

The error of pictures is taken as that of Gaussians which are not all there, and beside it that of numbers which are rounded. Only the
second changes with the level: by a part that hardly differs between avatars.

Source: own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from sacha_core.codec.levels import MAX_QUALITY, MIN_QUALITY
from sacha_core.rate.target import DB_PER_LEVEL, LOG_BYTES_PER_LEVEL

__all__ = ["Goal", "Measured", "Prospect", "SameQuality", "SameSize"]

# Of the error by rounding this is left when numbers made up for one another: 0.70 at 39 dB, 0.5 to 0.7 at 45 dB
FITTED = 0.65
LEAST_ERROR = 1e-12  # mean squared, of pictures that are the same


@dataclass(frozen=True)
class Measured:
    """Some Gaussians, as they are and as decoded.

    Args:
        quality: of the level that they were encoded at.
        n_bytes: of all that describes Gaussians.
        free_db: PSNR before encoding.
        coded_db: as decoded.
    """

    quality: float
    n_bytes: int
    free_db: float
    coded_db: float

    @property
    def missing(self) -> float:
        """Mean squared error by what is not there."""
        return max(10 ** (-self.free_db / 10), LEAST_ERROR)

    @property
    def rounding(self) -> float:
        """Mean squared error by what is rounded, once it was fitted."""
        return FITTED * max(10 ** (-self.coded_db / 10) - self.missing, LEAST_ERROR)


@dataclass(frozen=True)
class Prospect:
    """What Gaussians promise.

    Args:
        quality: of the level at which they meet the goal, about.
        cost: of two prospects the one of lower cost is better; infinite where the goal is out of reach.
    """

    quality: float
    cost: float


class Goal(Protocol):
    """What a file shall be."""

    def prospect(self, measured: Measured) -> Prospect:
        """Give what some Gaussians promise."""
        ...


@dataclass(frozen=True)
class SameQuality:
    """A PSNR, in as few bytes as possible.

    Args:
        decibels: as `judging.Judge.quick` gives them.
    """

    decibels: float

    def prospect(self, measured: Measured) -> Prospect:
        """Give the level that leaves room for no more rounding than that, and as cost the logarithm of the bytes."""
        room = 10 ** (-self.decibels / 10) - measured.missing
        if room <= LEAST_ERROR:
            return Prospect(measured.quality, math.inf)
        finer = 10 * math.log10(measured.rounding / room) / DB_PER_LEVEL
        quality = measured.quality + finer
        reached = quality <= MAX_QUALITY
        cost = math.log(measured.n_bytes) + LOG_BYTES_PER_LEVEL * finer
        return Prospect(min(max(quality, MIN_QUALITY), MAX_QUALITY), cost if reached else math.inf)


@dataclass(frozen=True)
class SameSize:
    """A size, with as little error as possible.

    Args:
        n_bytes: of all that describes Gaussians.
    """

    n_bytes: int

    def prospect(self, measured: Measured) -> Prospect:
        """Give the level that takes so many bytes, and as cost the error at it."""
        finer = math.log(self.n_bytes / measured.n_bytes) / LOG_BYTES_PER_LEVEL
        quality = measured.quality + finer
        reached = quality >= MIN_QUALITY
        cost = measured.missing + measured.rounding * 10 ** (-DB_PER_LEVEL * finer / 10)
        return Prospect(min(max(quality, MIN_QUALITY), MAX_QUALITY), cost if reached else math.inf)
