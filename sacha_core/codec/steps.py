r"""Quantiser steps, and how they follow what a Gaussian contributes to a picture.

All values are integers in a fine unit. Steps are $\lfloor 2^{e/8}\rfloor$ units for an exponent e, an eighth of an octave apart. A rule
gives the exponent of each Gaussian from four *classes* that the decoder knows by then: how transparent it is, how small, how elongated,
all in half octaves, and how hidden, of which the encoder tells. Everything is integer arithmetic, the same on every machine.

Source: own; an error in an attribute shows in proportion to opacity and to the root of the area.
"""

from __future__ import annotations

import math
import struct
from dataclasses import astuple, dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.reading import ByteReader

__all__ = ["MAX_EXPONENT", "MAX_HIDDEN", "PER_OCTAVE", "STEPS", "Classes", "StepRule", "dequantise"]

PER_OCTAVE = 8
MAX_HIDDEN = 7
MAX_EXPONENT = 28 * PER_OCTAVE - 1
STEPS = np.array([math.isqrt(math.isqrt(math.isqrt(1 << e))) for e in range(MAX_EXPONENT + 1)], np.int64)
LAYOUT = "5bBBB"


@dataclass(frozen=True)
class Classes:
    """What steps depend on: one integer a Gaussian each.

    Args:
        transparency: (n,) half octaves of 1 / opacity, 0 or more.
        size: (n,) half octaves of the root of the product of the two larger scales.
        elongation: (n,) half octaves of the largest over the second scale, 0 or more.
        hidden: (n,) how little of it is seen, 0 (as much as the other classes lead to expect) to `MAX_HIDDEN`.
    """

    transparency: Int[np.ndarray, " n"]
    size: Int[np.ndarray, " n"]
    elongation: Int[np.ndarray, " n"]
    hidden: Int[np.ndarray, " n"]


@dataclass(frozen=True)
class StepRule:
    """How steps follow from classes.

    Args:
        transparency: weight of that class, in quarters, which makes eighths of an octave of half octaves.
        size: weight of (reference - size class), in quarters: small Gaussians get coarse steps.
        elongation: weight of minus that class, in quarters: long Gaussians get fine steps.
        reference: size class at which size adds nothing.
        low: the least that these three may add to the exponent, eighths of an octave.
        high: the most that they may add.
        base: exponent of a Gaussian to which the classes add nothing.
        hidden: weight of that class, 0 or more: what is hidden gets coarse steps.
    """

    transparency: int
    size: int
    elongation: int
    reference: int
    low: int
    high: int
    base: int
    hidden: int = 0

    def shift(self, classes: Classes) -> Int[np.ndarray, " n"]:
        """What the classes add to the exponent of each Gaussian."""
        total = self.transparency * classes.transparency + self.size * (self.reference - classes.size)
        seen = np.clip(total - self.elongation * classes.elongation, self.low, self.high)
        return np.asarray(seen + self.hidden * classes.hidden)

    @property
    def most(self) -> int:
        """The largest shift."""
        return self.high + self.hidden * MAX_HIDDEN

    def moved(self, exponent: int) -> StepRule:
        """Give the rule with its base moved by so much, or as far as the table of steps allows."""
        return replace(self, base=max(min(self.base + exponent, MAX_EXPONENT - self.most), -self.low, 0))

    def steps(self, classes: Classes) -> Int[np.ndarray, " n"]:
        """Step of each Gaussian, in fine units."""
        return np.asarray(STEPS[self.base + self.shift(classes)])

    def pack(self) -> bytes:
        """Write the rule in 8 bytes."""
        return struct.pack("<" + LAYOUT, *astuple(self))

    @classmethod
    def unpack(cls, reader: ByteReader) -> StepRule:
        """Read a rule.

        Raises:
            FormatError: an exponent would leave the table of steps.
        """
        rule = cls(*reader.unpack(LAYOUT))
        if not (rule.low <= rule.high and rule.base + rule.low >= 0 and rule.base + rule.most <= MAX_EXPONENT):
            raise reader.error(
                f"steps reach from {rule.base + rule.low} to {rule.base + rule.most}, table is 0 to {MAX_EXPONENT}"
            )
        return rule


def dequantise(values: Int[np.ndarray, "..."], unit: float) -> Float[np.ndarray, "..."]:
    """Turn integers in units of `unit` (a power of two) into float32."""
    return (values.astype(np.float64) * unit).astype(np.float32)
