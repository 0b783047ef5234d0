"""Streams of integers under contexts: frequency tables in front, then raw bits, then range-asymmetric coded tokens.

A writer is fed batches of integers, each integer with a context; at the end it groups contexts that behave alike, makes one table for each
group, and codes. A reader asks for the same batches in the same order, so that the contexts of a batch may depend on the batches before.

Source: own; the coder is constriction's `AnsCoder` (Bamler, 2022), specified in FORMAT.md, "Tokens".
"""

from __future__ import annotations

import struct

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec import tokens as token_split
from sacha_core.codec.grouping import LevelBits, fit_table, group_contexts
from sacha_core.codec.loops import compiled_loops
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.tables import MAX_TABLES, read_tables, write_tables
from sacha_core.codec.token_stack import CompiledStack, PlainStack, interval_begins, stack_of
from sacha_core.errors import FormatError

__all__ = ["SymbolReader", "SymbolWriter"]

PRECISION_BITS = 24  # of a probability
TOKENS_PER_WORD = 8  # roughly; only steers by which loops they are read
HEAD = "BII"  # number of tables, bytes of the tables, bytes of the raw bits


class SymbolWriter:
    """Collects batches of integers and codes them.

    Args:
        n_contexts: contexts run from 0 to n_contexts - 1.
    """

    def __init__(self, n_contexts: int) -> None:
        self._n_contexts = n_contexts
        self._batches: list[tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]] = []

    def write(self, values: Int[np.ndarray, "..."], contexts: Int[np.ndarray, "..."]) -> None:
        """Add a batch; both arrays are read in C order.

        Raises:
            FormatError: a value has no token.
        """
        if values.size and np.abs(values).max() > token_split.MAX_VALUE:
            raise FormatError(
                f"{np.abs(values).max()} steps off its prediction; the format holds up to {token_split.MAX_VALUE}"
            )
        self._batches.append((values.reshape(-1).astype(np.int64), contexts.reshape(-1).astype(np.int64)))

    def _collected(self) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"], Int[np.ndarray, "c a"]]:
        """Give all values and contexts, and how often each token occurs in each context."""
        values = np.concatenate([np.zeros(0, np.int64), *(batch[0] for batch in self._batches)])
        contexts = np.concatenate([np.zeros(0, np.int64), *(batch[1] for batch in self._batches)])
        width = 2 * token_split.MAX_TOKEN + 1
        cells = contexts * width + token_split.split_tokens(values)[0] + token_split.MAX_TOKEN
        counts = np.bincount(cells, minlength=self._n_contexts * width).reshape(self._n_contexts, width)
        return values, contexts, counts

    def level_bits(self) -> LevelBits:
        """Give what levels would cost in the tables of this stream."""
        counts = self._collected()[2]
        if not counts.any():
            return LevelBits(np.zeros(counts.shape))
        table_of, grouped = group_contexts(counts)
        return LevelBits.of_counts(grouped)[table_of]

    def finish(self) -> bytes:
        """Give the coded stream."""
        values, contexts, counts = self._collected()
        tokens, raw = token_split.split_tokens(values)
        table_of, grouped = group_contexts(counts)
        tables = [fit_table(row) for row in grouped]
        coded_tables = write_tables(table_of, tables)
        bits = token_split.pack_bits(raw, token_split.raw_lengths(tokens))
        head = struct.pack("<" + HEAD, len(tables), len(coded_tables), len(bits))
        lengths = [len(batch) for batch, _ in self._batches]
        return head + coded_tables + bits + stack_of(lengths, tokens, table_of[contexts], tables)


class SymbolReader:
    """Reads batches as `SymbolWriter` wrote them; takes everything that is left in `reader`.

    Raises:
        FormatError: tables, raw bits or coded words are not what an encoder writes.
    """

    def __init__(self, reader: ByteReader, n_contexts: int) -> None:
        self._reader = reader
        n_tables, table_bytes, bit_bytes = reader.unpack(HEAD)
        if n_tables > MAX_TABLES:
            raise reader.error(f"{n_tables} tables, at most {MAX_TABLES} are allowed")
        offset = reader.offset
        self._table_of, self._tables = read_tables(reader.take(table_bytes), n_contexts, n_tables, offset)
        direct = token_split.DIRECT
        self._far = any(first <= -direct or first + len(grades) > direct for first, grades in self._tables)
        self._bits = np.unpackbits(np.frombuffer(reader.take(bit_bytes), np.uint8))
        self._bits_used = 0
        raw = reader.take(reader.left)
        if len(raw) % 4:
            raise reader.error(f"coded words take {len(raw)} bytes, not a multiple of 4")
        words = np.frombuffer(raw, "<u4").astype(np.uint32)
        if len(words) and words[-1] == 0:
            raise reader.error("the last coded word is zero, which no encoder writes")
        self._loops = compiled_loops("tokens", TOKENS_PER_WORD * len(words))
        self._stack = (
            CompiledStack(words, self._tables, self._table_of, self._loops)
            if self._loops
            else PlainStack(words, self._tables, self._table_of)
        )

    def read(self, contexts: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Read one integer for each context, in C order."""
        flat = contexts.reshape(-1)
        if flat.size and not self._tables:
            raise self._reader.error(f"{flat.size} symbols are due, but there is no table")
        values = self._stack.take(np.ascontiguousarray(flat, np.int64))
        if isinstance(values, int):
            raise self._reader.error(f"a token beyond the last of table {values}")
        if self._far:
            self._join(values)
        if self._reader.log is not None:
            self._reader.log.append(self._bits_of(flat, values))
        return values.reshape(contexts.shape)

    def _bits_of(self, contexts: Int[np.ndarray, " m"], values: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Give what each integer has cost: the logarithm of its token's share of the coder's intervals, and its raw bits."""
        tokens = token_split.split_tokens(values)[0]
        bits = token_split.raw_lengths(tokens).astype(np.float64)
        table_of = self._table_of[contexts]
        for table in np.unique(table_of).tolist():
            first, grades = self._tables[table]
            mine = table_of == table
            widths = np.diff(interval_begins(grades, PRECISION_BITS))
            bits[mine] += (PRECISION_BITS - np.log2(widths))[tokens[mine] - first]
        return bits

    def _join(self, values: Int[np.ndarray, " m"]) -> None:
        """Turn tokens that raw bits follow into integers."""
        direct, used = token_split.DIRECT, self._bits_used
        if self._loops:
            used = self._loops.take_raw(values, self._bits, used, direct, token_split.MANTISSA_BITS)
        else:
            far = np.flatnonzero(np.abs(values) >= direct)  # most values are a token alone
            lengths = token_split.raw_lengths(values[far])
            used += int(lengths.sum())
            if used <= len(self._bits):
                raw = token_split.unpack_bits(self._bits, self._bits_used, lengths)
                values[far] = token_split.join_tokens(values[far], raw)
        if not 0 <= used <= len(self._bits):
            raise self._reader.error("the raw bits end too early")
        self._bits_used = used

    def check_end(self) -> None:
        """Check that every word and every raw bit was used.

        Raises:
            FormatError: something is left over.
        """
        if not self._stack.is_empty():
            raise self._reader.error("coded words are left over, or were cut: the symbols do not add up")
        left = self._bits[self._bits_used :]
        if len(left) >= 8 or left.any():
            raise self._reader.error(f"{len(left)} raw bits are left over")
