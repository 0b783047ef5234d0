"""The stack that tokens are read from: words of constriction's range-asymmetric coder, taken by it or by compiled loops, which is the same.

Source: own; the coder is constriction's `AnsCoder` (Bamler, 2022), specified in FORMAT.md, "Tokens".
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import constriction
import numpy as np
from jaxtyping import Int, UInt

from sacha_core.codec.tables import table_weights

__all__ = ["CompiledStack", "PlainStack", "interval_begins", "stack_of"]

Tables = list[tuple[int, Int[np.ndarray, "..."]]]


def make_model(grades: Int[np.ndarray, " a"]) -> Any:
    """Give the entropy model of a table."""
    return constriction.stream.model.Categorical(table_weights(grades), perfect=False)


def stack_of(
    lengths: Sequence[int], tokens: Int[np.ndarray, " m"], table_of: Int[np.ndarray, " m"], tables: Tables
) -> bytes:
    """Push tokens onto the stack, last first: of batches of such lengths, each token by its table; give the words."""
    coder = constriction.stream.stack.AnsCoder()
    models = [make_model(grades) for _, grades in tables]
    end = len(tokens)
    for length in reversed(lengths):
        start = end - length
        for table in range(len(tables) - 1, -1, -1):
            mine = tokens[start:end][table_of[start:end] == table]
            if len(mine):
                coder.encode_reverse((mine - tables[table][0]).astype(np.int32), models[table])
        end = start
    return bytes(coder.get_compressed().astype("<u4").tobytes())


class PlainStack:
    """Tokens by constriction, table by table.

    Args:
        words: of the stack, the last of which is not 0.
        tables: first token and grades of each.
        table_of: (c,) which of them each context uses.
    """

    def __init__(self, words: UInt[np.ndarray, " w"], tables: Tables, table_of: Int[np.ndarray, " c"]) -> None:
        self._coder = constriction.stream.stack.AnsCoder(words)
        self._table_of = table_of.astype(np.uint8)  # 64 tables fit, and sort faster
        self._models = [make_model(grades) for _, grades in tables]
        self._firsts = np.array([first for first, _ in tables], np.int64)
        self._single = [len(grades) == 1 for _, grades in tables]  # have a weight that stands for no token

    def take(self, contexts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"] | int:
        """Read a token for each context, or give the number of a table that one lies beyond."""
        table_of = self._table_of[contexts]
        counts = np.bincount(table_of, minlength=len(self._models))
        by_table = np.repeat(self._firsts, counts)
        start = 0
        for table in np.flatnonzero(counts).tolist():
            end = start + int(counts[table])
            symbols = self._coder.decode(self._models[table], end - start)
            if self._single[table] and symbols.any():
                return table
            by_table[start:end] += symbols
            start = end
        tokens = np.empty(len(contexts), np.int64)
        tokens[np.argsort(table_of, kind="stable")] = by_table
        return tokens

    def is_empty(self) -> bool:
        """Tell whether everything was taken."""
        return bool(self._coder.is_empty())


class CompiledStack:
    """Tokens by compiled loops.

    Args:
        words, tables, table_of: as of `PlainStack`.
        loops: `kernels.tokens`.
    """

    def __init__(
        self, words: UInt[np.ndarray, " w"], tables: Tables, table_of: Int[np.ndarray, " c"], loops: ModuleType
    ) -> None:
        self._loops, self._words, self._table_of = loops, words, table_of
        self._firsts = np.array([first for first, _ in tables], np.int64)
        begins = [interval_begins(grades, loops.PRECISION_BITS) for _, grades in tables]
        self._spans = np.cumsum([0, *(len(one) for one in begins)])[:-1]
        self._lasts = self._spans + np.array([len(grades) - 1 for _, grades in tables], np.int64)
        marks = np.arange(1 << (loops.PRECISION_BITS - loops.QUICK_BITS)) << loops.QUICK_BITS
        quick = [np.searchsorted(one, marks, side="right") - 1 for one in begins]
        self._quick = np.array(quick, np.int64).reshape(-1, len(marks))
        self._begins = np.concatenate([np.zeros(0, np.int64), *begins]).astype(np.uint64)
        first_words = [int(word) for word in words[-2:]]  # the last in the high half
        state = sum(word << (32 * place) for place, word in enumerate(first_words))
        self._registers = np.array([state, len(words) - len(first_words)], np.uint64)

    def take(self, contexts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"] | int:
        """Read a token for each context, or give the number of a table that one lies beyond."""
        tokens = np.empty(len(contexts), np.int64)
        tables = self._table_of, self._spans, self._lasts, self._begins, self._quick, self._firsts
        beyond = self._loops.take_tokens(contexts, *tables, self._words, self._registers, tokens)
        return tokens if beyond == self._loops.FINE else int(beyond)

    def is_empty(self) -> bool:
        """Tell whether everything was taken."""
        return not self._registers.any()


def interval_begins(grades: Int[np.ndarray, " a"], precision_bits: int) -> Int[np.ndarray, " b"]:
    """Give where the interval of each token of a table begins, and where the last one ends."""
    weights = table_weights(grades)
    before = np.concatenate([[0.0], np.cumsum(weights)[:-1]])
    spare = ((1 << precision_bits) - len(weights)) / weights.sum()
    begins = np.floor(spare * before).astype(np.int64) + np.arange(len(weights))
    return np.append(begins, 1 << precision_bits)
