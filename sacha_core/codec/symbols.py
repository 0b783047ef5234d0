"""Streams of integers under contexts: frequency tables in front, then raw bits, then range-asymmetric coded tokens.

A writer is fed batches of integers, each integer with a context; at the end it groups contexts that behave alike, makes one table for each
group, and codes. A reader asks for the same batches in the same order, so that the contexts of a batch may depend on the batches before.

Source: own; the coder is constriction's `AnsCoder` (Bamler, 2022), specified in FORMAT.md, "Tokens".
"""

from __future__ import annotations

import struct
from typing import Any

import constriction
import numpy as np
from jaxtyping import Int

from sacha_core.codec import tokens as token_split
from sacha_core.codec.grouping import LevelBits, fit_table, group_contexts
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.tables import MAX_TABLES, read_tables, table_weights, write_tables
from sacha_core.errors import FormatError

__all__ = ["SymbolReader", "SymbolWriter"]

HEAD = "BII"  # number of tables, bytes of the tables, bytes of the raw bits


def make_model(grades: Int[np.ndarray, " a"]) -> Any:
    """Give the entropy model of a table."""
    return constriction.stream.model.Categorical(table_weights(grades), perfect=False)


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
        return head + coded_tables + bits + self._code(tokens, table_of[contexts], tables)

    def _code(
        self,
        tokens: Int[np.ndarray, " m"],
        table_of: Int[np.ndarray, " m"],
        tables: list[tuple[int, Int[np.ndarray, "..."]]],
    ) -> bytes:
        """Push every token onto the stack coder, last first."""
        coder = constriction.stream.stack.AnsCoder()
        models = [make_model(grades) for _, grades in tables]
        end = len(tokens)
        for batch, _ in reversed(self._batches):
            start = end - len(batch)
            for table in range(len(tables) - 1, -1, -1):
                mine = tokens[start:end][table_of[start:end] == table]
                if len(mine):
                    coder.encode_reverse((mine - tables[table][0]).astype(np.int32), models[table])
            end = start
        return bytes(coder.get_compressed().astype("<u4").tobytes())


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
        self._table_of = self._table_of.astype(np.uint8)  # 64 tables fit, and sort faster
        self._models = [make_model(grades) for _, grades in self._tables]
        self._firsts = np.array([first for first, _ in self._tables], np.int64)
        self._single = [len(grades) == 1 for _, grades in self._tables]  # have a weight that stands for no token
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
        self._coder = constriction.stream.stack.AnsCoder(words)

    def read(self, contexts: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Read one integer for each context, in C order."""
        flat = contexts.reshape(-1)
        if flat.size and not self._tables:
            raise self._reader.error(f"{flat.size} symbols are due, but there is no table")
        values = self._read_tokens(flat)
        if self._far:
            split = np.flatnonzero(np.abs(values) >= token_split.DIRECT)  # most values are a token alone
            if len(split):
                values[split] = self._joined(values[split])
        return values.reshape(contexts.shape)

    def _read_tokens(self, contexts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Read a token for each context; those of a table lie together."""
        table_of = self._table_of[contexts]
        counts = np.bincount(table_of, minlength=len(self._models))
        by_table = np.repeat(self._firsts, counts)
        start = 0
        for table in np.flatnonzero(counts).tolist():
            end = start + int(counts[table])
            symbols = self._coder.decode(self._models[table], end - start)
            if self._single[table] and symbols.any():
                raise self._reader.error(f"a token beyond the last of table {table}")
            by_table[start:end] += symbols
            start = end
        tokens = np.empty(len(contexts), np.int64)
        tokens[np.argsort(table_of, kind="stable")] = by_table
        return tokens

    def _joined(self, tokens: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Give the integers of tokens that raw bits follow."""
        lengths = token_split.raw_lengths(tokens)
        n_bits = int(lengths.sum())
        if self._bits_used + n_bits > len(self._bits):
            raise self._reader.error("the raw bits end too early")
        raw = token_split.unpack_bits(self._bits, self._bits_used, lengths)
        self._bits_used += n_bits
        return token_split.join_tokens(tokens, raw)

    def check_end(self) -> None:
        """Check that every word and every raw bit was used.

        Raises:
            FormatError: something is left over.
        """
        if not self._coder.is_empty():
            raise self._reader.error("coded words are left over, or were cut: the symbols do not add up")
        left = self._bits[self._bits_used :]
        if len(left) >= 8 or left.any():
            raise self._reader.error(f"{len(left)} raw bits are left over")
