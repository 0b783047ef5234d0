"""Arrays of float32 coded bit for bit, column after column; FORMAT.md, "Exact numbers".

Source: own.
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec import float_column as rules
from sacha_core.codec.column_choice import choose_column
from sacha_core.codec.float_column import Column, between, neighbours, passes_of
from sacha_core.codec.float_symbols import Symbols, direct_symbols, join_direct, join_residual, residual_symbols
from sacha_core.codec.listed_column import (
    LENGTH_MIDDLE,
    bits_at,
    finite_bits,
    join_list,
    list_symbols,
    listed_of,
    place_of,
    place_symbols,
)  # fmt: skip
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter
from sacha_core.codec.tokens import pack_bits, unpack_bits

__all__ = ["decode_exactly", "encode_exactly"]

LAYOUT = "BII"  # groups of columns, bytes of the columns' descriptions, bytes of noise
MAX_GROUPS = 4


def spread_of(left: Float[np.ndarray, " p"], right: Float[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
    """How far neighbours are from each other, in classes of eightfold distances between their bits."""
    ordered = [np.where(np.signbit(one), -rules.magnitudes(one), rules.magnitudes(one)) for one in (left, right)]
    return np.asarray(rules.bit_length(np.abs(ordered[0] - ordered[1])) // 3)


def lead_contexts(
    column: Column, expected: Float[np.ndarray, " p"], spread: Int[np.ndarray, " p"]
) -> Int[np.ndarray, " p"]:
    """Contexts of leading symbols, within a group."""
    if column.mode == rules.DIRECT:
        return rules.LEAD_DIRECT + column.bins(expected)
    return rules.LEAD_RESIDUAL + spread


def next_contexts(
    column: Column, expected: Float[np.ndarray, " p"], lead: Int[np.ndarray, " p"]
) -> Int[np.ndarray, " p"]:
    """Contexts of following symbols, within a group."""
    if column.mode == rules.DIRECT:
        family = 2 * np.clip(np.abs(lead) - 1, 0, rules.FAMILIES // 2 - 1) + (lead < 0)
        return np.asarray(rules.NEXT_DIRECT + column.bins(expected) * rules.FAMILIES + family)
    return np.asarray(rules.NEXT_RESIDUAL + lead + column.anchor)


def encode_exactly(values: Float[np.ndarray, "n c"], n_groups: int) -> bytes:
    """Code an array of finite float32 numbers, rows in coding order.

    Args:
        values: (n, c).
        n_groups: columns this far apart behave alike and share contexts (1 to 4).
    """
    n, width = values.shape
    left, right = neighbours(n)
    writer = SymbolWriter(n_groups * rules.CONTEXTS)
    heads, noise, lengths = [], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    wide = values.astype(np.float64)
    off = np.zeros((n, 0))
    for place in range(width):
        x = np.ascontiguousarray(values[:, place])
        centre = np.sort(x)[n // 2] if n else np.float32(0)  # a median of two could overflow
        mean = between(x[left], x[right])
        mean[:1] = centre
        spread = spread_of(x[left], x[right])
        earlier = [wide[:, place - 1 - j] for j in range(min(place, rules.REACH))]
        distances = [off[:, -1 - j] for j in range(min(place, rules.REACH))]
        column = choose_column(x, float(centre), mean, earlier, distances, spread)
        heads.append(column.pack())
        off = np.column_stack([off, wide[:, place] - mean])[:, -rules.REACH :]
        if column.mode == rules.CONSTANT:
            continue
        base = place % n_groups * rules.CONTEXTS
        expected = column.expected(mean, earlier, distances)
        if column.mode == rules.LISTED:
            symbols, *rest = list_symbols(listed_of(x))
            writer.write(symbols, np.full(len(symbols), base + rules.LIST))
            noise.append(rest[0])
            lengths.append(rest[1])
        told = symbols_of(x, expected, column)
        rows = write_column(writer, column, told, expected, spread, base)
        noise.append(told.noise[rows])
        lengths.append(told.lengths[rows])
    bits = pack_bits(np.concatenate(noise), np.concatenate(lengths))
    described = b"".join(heads)
    return struct.pack("<" + LAYOUT, n_groups, len(described), len(bits)) + described + bits + writer.finish()


def symbols_of(x: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], column: Column) -> Symbols:
    """Give the symbols of a column in its mode."""
    if column.mode == rules.LISTED:
        return place_symbols(x, expected)
    return direct_symbols(x, column) if column.mode == rules.DIRECT else residual_symbols(x, expected, column)


def write_column(
    writer: SymbolWriter,
    column: Column,
    told: Symbols,
    expected: Float[np.ndarray, " n"],
    spread: Int[np.ndarray, " n"],
    base: int,
) -> Int[np.ndarray, " n"]:
    """Write the symbols of a column, pass by pass; give its rows in that order."""
    leads = base + lead_contexts(column, expected, spread)
    nexts = base + next_contexts(column, expected, told.lead)  # unused where nothing follows
    passes = [rows for rows, _, _ in passes_of(len(expected))]
    for rows in passes:
        writer.write(told.lead[rows], leads[rows])
        more = rows[told.has_next[rows]]
        if column.mode != rules.LISTED:
            writer.write(told.next[more], nexts[more])
    return np.concatenate(passes)


def decode_exactly(reader: ByteReader, n: int, width: int) -> Float[np.ndarray, "n c"]:
    """Read an array of n rows and `width` columns.

    Raises:
        FormatError: the bytes are not what an encoder writes, or a number is not finite.
    """
    n_groups, head_bytes, noise_bytes = reader.unpack(LAYOUT)
    if not 1 <= n_groups <= MAX_GROUPS:
        raise reader.error(f"{n_groups} groups of columns, expected 1 to {MAX_GROUPS}")
    heads = reader.part(head_bytes)
    columns = [Column.unpack(heads, place, n) for place in range(width)]
    heads.check_end()
    noise = Noise(reader.part(noise_bytes))
    symbols = SymbolReader(reader, n_groups * rules.CONTEXTS)
    passes = passes_of(n)
    left, right = neighbours(n)
    values = np.zeros((n, width), np.float32)
    off: list[Float[np.ndarray, " n"]] = []
    for place, column in enumerate(columns):
        x = np.full(n, column.centre, np.float32)
        if column.mode != rules.CONSTANT:
            earlier = [values[:, place - 1 - j].astype(np.float64) for j in range(min(place, rules.REACH))]
            read_column(reader, symbols, noise, column, x, passes, earlier, off, place % n_groups * rules.CONTEXTS)
        values[:, place] = x
        mean = between(x[left], x[right])
        mean[:1] = column.centre
        off = [x.astype(np.float64) - mean, *off][: rules.REACH]
    symbols.check_end()
    noise.check_end()
    return values


class Noise:
    """Bits that are sent as they are."""

    def __init__(self, reader: ByteReader) -> None:
        self._reader = reader
        self._bits = np.unpackbits(np.frombuffer(reader.take(reader.left), np.uint8))
        self._at = 0

    def read(self, lengths: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Read integers of these lengths.

        Raises:
            FormatError: fewer bits are left.
        """
        total = int(lengths.sum())
        if total > len(self._bits) - self._at:
            raise self._reader.error(f"{total} bits of noise expected, {len(self._bits) - self._at} left")
        values = unpack_bits(self._bits, self._at, lengths)
        self._at += total
        if self._reader.log is not None:
            self._reader.log.append(lengths.astype(np.float64))
        return values

    def check_end(self) -> None:
        """Check that what is left only fills the last byte.

        Raises:
            FormatError: it does not.
        """
        rest = self._bits[self._at :]
        if len(rest) >= 8 or rest.any():
            raise self._reader.error(f"{len(rest)} bits of noise are left over")


def read_column(
    reader: ByteReader,
    symbols: SymbolReader,
    noise: Noise,
    column: Column,
    x: Float[np.ndarray, " n"],
    passes: list[rules.Pass],
    earlier: list[Float[np.ndarray, " n"]],
    off: list[Float[np.ndarray, " n"]],
    base: int,
) -> None:
    """Read a column into `x`, pass by pass.

    Raises:
        FormatError: a number is not finite, or a symbol is none that an encoder writes.
    """
    listed = read_list(reader, symbols, noise, column, base) if column.mode == rules.LISTED else None
    for number, (rows, left, right) in enumerate(passes):
        mean, spread = between(x[left], x[right]), spread_of(x[left], x[right])
        if number == 0:
            mean, spread = np.full(1, column.centre), np.zeros(1, np.int64)
        expected = column.expected(mean, [one[rows] for one in earlier], [one[rows] for one in off])
        lead = symbols.read(base + lead_contexts(column, expected, spread))
        if listed is not None:
            bits = bits_at(place_of(expected, listed) + lead, listed)
        else:
            bits = read_bits(reader, symbols, noise, column, expected, lead, base)
        if ((bits < 0) | (bits & 0x7FFFFFFF >= 0x7F800000)).any():
            raise reader.error("a number that is not finite or not in its list")
        x[rows] = bits.astype(np.uint32).view(np.float32)


def read_list(
    reader: ByteReader, symbols: SymbolReader, noise: Noise, column: Column, base: int
) -> Int[np.ndarray, " m"]:
    """Read the list of a column's different numbers.

    Raises:
        FormatError: it does not ascend, or leaves the finite numbers.
    """
    length = symbols.read(np.full(column.n_listed, base + rules.LIST)) + LENGTH_MIDDLE
    if length.min() < 0 or length.max() > rules.LENGTHS:
        raise reader.error("a length in a list out of its range")
    listed = join_list(length, noise.read(np.maximum(length - 1, 0)))
    if not finite_bits(listed):
        raise reader.error("a list of numbers that does not ascend or is not finite")
    return listed


def read_bits(
    reader: ByteReader,
    symbols: SymbolReader,
    noise: Noise,
    column: Column,
    expected: Float[np.ndarray, " p"],
    lead: Int[np.ndarray, " p"],
    base: int,
) -> Int[np.ndarray, " p"]:
    """Read what follows the leading symbols of a pass; give the bits of its numbers, negative where they are none.

    Raises:
        FormatError: a symbol is none that an encoder writes.
    """
    more = lead != 0 if column.mode == rules.DIRECT else np.ones(len(lead), bool)
    if column.mode == rules.DIRECT:
        fine = bool((~more | (column.anchor + 1 - np.abs(lead) >= 0)).all())
    else:
        fine = bool(((lead + column.anchor >= 0) & (lead + column.anchor < rules.LENGTHS)).all())
    if not fine:
        raise reader.error("a leading symbol out of its range")
    following = np.zeros(len(lead), np.int64)
    following[more] = symbols.read(base + next_contexts(column, expected, lead)[more])
    if following.min(initial=0) < 0 or following.max(initial=0) > 15:
        raise reader.error("a following symbol out of its range")
    if column.mode == rules.DIRECT:
        return join_direct(lead, following, noise, column)
    return join_residual(lead, following, noise, expected, column)
