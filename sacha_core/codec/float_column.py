r"""Lossless columns of float32: what a number is expected to be, and how it is said exactly.

A row lies between two known ones, its *neighbours*; a number is expected at their mean, moved by how far the numbers of earlier columns
of the row were off theirs. It is then told in one of two ways, whichever is shorter for the column: by its own sign and exponent under a
context of the expected value, or by the distance of its bits from those of the expected value. What follows the leading bits is noise,
and sent as it is.

Source: own; bits as ordered integers after Lindstrom and Isenburg, Fast and Efficient Compression of Floating-Point Data, 2006.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.reading import ByteReader

__all__ = [
    "CONSTANT",
    "CONTEXTS",
    "DIRECT",
    "LISTED",
    "RESIDUAL",
    "UNIT",
    "Column",
    "between",
    "bit_length",
    "from_ordered",
    "magnitudes",
    "neighbours",
    "ordered",
    "passes_of",
]

CONSTANT, DIRECT, RESIDUAL, UNIT, LISTED = range(5)  # modes
REACH = 3  # earlier columns that an expectation draws on
HEAD, FIELDS = "Bf", f"BB{REACH + 1}hB"
FRACTION = 2.0**-12  # of coefficients
MAX_THRESHOLDS = 15
MAX_ZEROS = 19
LARGEST = float(np.finfo(np.float32).max)
SPREADS, BINS, FAMILIES, LENGTHS = 11, MAX_THRESHOLDS + 1, 12, 32
# contexts of a group of columns: leading symbols by spread or by bin, following ones by length or by bin and family; and one for lists
LEAD_RESIDUAL, LEAD_DIRECT = 0, SPREADS
NEXT_RESIDUAL = LEAD_DIRECT + BINS
NEXT_DIRECT = NEXT_RESIDUAL + LENGTHS
LIST = NEXT_DIRECT + BINS * FAMILIES
CONTEXTS = LIST + 1

Pass = tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"], Int[np.ndarray, " p"]]


def passes_of(n: int) -> list[Pass]:
    """Rows in the order of coding, those of a pass between rows of passes before: rows, left and right neighbours."""
    first = np.zeros(min(n, 1), np.int64)
    passes = [(first, first, first)] if n else []
    half = (1 << (n - 1).bit_length()) // 2 if n else 0
    while half:
        rows = np.arange(half, n, 2 * half)
        if len(rows):
            passes.append((rows, rows - half, np.where(rows + half < n, rows + half, rows - half)))
        half //= 2
    return passes


def neighbours(n: int) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Left and right neighbour of every row; row 0 is its own."""
    left, right = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for rows, before, behind in passes_of(n):
        left[rows], right[rows] = before, behind
    return left, right


def between(left: Float[np.ndarray, " p"], right: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """Mean of two float32 numbers each, in float64."""
    return np.asarray((left.astype(np.float64) + right.astype(np.float64)) * 0.5)


def magnitudes(values: Float[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Bits of float32 numbers without their sign: integers in the order of magnitudes."""
    return values.view(np.uint32).astype(np.int64) & 0x7FFFFFFF


def ordered(values: Float[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Bits of float32 numbers as integers in the order of the numbers; -0 lies just below 0."""
    bits = magnitudes(values)
    return np.asarray(np.where(np.signbit(values), -1 - bits, bits))


def from_ordered(places: Int[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Give the bits of float32 numbers that `ordered` gave."""
    return np.asarray(np.where(places < 0, (-1 - places) | 1 << 31, places))


def bit_length(whole: Int[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """Bits of integers from 0 to 2**53."""
    return np.frexp(whole.astype(np.float64))[1].astype(np.int64)


@dataclass(frozen=True)
class Column:
    """How one column is told.

    Args:
        mode: CONSTANT (every number is the centre), DIRECT (sign, exponent, four bits of the mantissa; then noise), RESIDUAL (distance from
            the expected value), UNIT (the same, expected where it makes the row a unit vector with the three numbers before it), LISTED
            (by its place in a list of all different numbers).
        centre: what is expected without neighbours.
        zeros: low bits that are 0 in every number.
        anchor: greatest exponent (DIRECT), usual length of a distance (RESIDUAL, UNIT).
        coefficients: what is made of the neighbours' mean and of earlier columns, in 2**-12.
        thresholds: float32 numbers that cut expected values into contexts (DIRECT).
        n_listed: how many different numbers there are (LISTED).
    """

    mode: int
    centre: float
    zeros: int = 0
    anchor: int = 0
    coefficients: tuple[int, ...] = (0,) * (REACH + 1)
    thresholds: tuple[float, ...] = ()
    n_listed: int = 0

    def pack(self) -> bytes:
        """Write what a decoder has to know."""
        head = struct.pack("<" + HEAD, self.mode, self.centre)
        if self.mode == CONSTANT:
            return head
        fields = struct.pack("<" + FIELDS, self.zeros, self.anchor, *self.coefficients, len(self.thresholds))
        listed = struct.pack("<I", self.n_listed) if self.mode == LISTED else b""
        return head + fields + struct.pack(f"<{len(self.thresholds)}f", *self.thresholds) + listed

    @classmethod
    def unpack(cls, reader: ByteReader, place: int, n: int) -> Column:
        """Read what `pack` wrote, of the column at this place in its array of n rows.

        Raises:
            FormatError: a field is out of range.
        """
        mode, centre = reader.unpack(HEAD)
        if mode > LISTED or not np.isfinite(centre) or (mode == UNIT and place < REACH):
            raise reader.error(f"column {place} of mode {mode} around {centre}")
        if mode == CONSTANT:
            return cls(mode, centre)
        zeros, anchor, *coefficients, n_thresholds = reader.unpack(FIELDS)
        if zeros > MAX_ZEROS or n_thresholds > MAX_THRESHOLDS or anchor > (254 if mode == DIRECT else LENGTHS - 1):
            raise reader.error(f"column {place} with {zeros} zeros, {n_thresholds} thresholds and anchor {anchor}")
        thresholds = reader.unpack(f"{n_thresholds}f")
        if not np.isfinite(thresholds).all():
            raise reader.error(f"column {place} has a threshold that is not finite")
        (n_listed,) = reader.unpack("I") if mode == LISTED else (0,)
        if mode == LISTED and not 1 <= n_listed <= n:
            raise reader.error(f"column {place} lists {n_listed} different numbers of {n}")
        return cls(mode, centre, zeros, anchor, tuple(coefficients), thresholds, n_listed)

    def expected(
        self, mean: Float[np.ndarray, " p"], earlier: list[Float[np.ndarray, " p"]], off: list[Float[np.ndarray, " p"]]
    ) -> Float[np.ndarray, " p"]:
        """What the numbers are expected to be.

        Args:
            mean: of the neighbours, float64; the centre in the first pass.
            earlier: numbers of up to three columns before, the nearest first, float64.
            off: how far those are from the means of their neighbours.

        Returns:
            float32.
        """
        if self.mode == UNIT:
            z, y, x = earlier
            rest = np.sqrt(np.maximum(1.0 - ((x * x + y * y) + z * z), 0.0))
            return np.asarray(np.where(mean < 0, -rest, rest).astype(np.float32))
        total = self.centre + (self.coefficients[0] * FRACTION) * (mean - self.centre)
        for coefficient, distance in zip(self.coefficients[1:], off, strict=False):
            total = total + (coefficient * FRACTION) * distance
        return np.asarray(np.clip(total, -LARGEST, LARGEST).astype(np.float32))

    def bins(self, expected: Float[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
        """Which thresholds the expected values lie between."""
        return np.asarray((expected[:, None] > np.array(self.thresholds, np.float32)).sum(axis=1))
