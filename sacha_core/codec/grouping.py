"""Which contexts share a table, and what integers cost in it.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec import tokens as token_split
from sacha_core.codec.tables import MAX_TABLES, count_bits, grades_of

__all__ = ["LevelBits", "fit_table", "group_contexts"]

UNSEEN = 0.5  # occurrences


@dataclass(frozen=True)
class LevelBits:
    """Bits of integers under contexts, raw bits included.

    Args:
        table: (c, a) of every token from the least on, in each context.
    """

    table: Float[np.ndarray, "c a"]

    @classmethod
    def of_counts(cls, counts: Int[np.ndarray, "c a"]) -> LevelBits:
        """Give the bits of tokens that occurred so often; one that did not costs what half an occurrence would."""
        often = np.maximum(counts, UNSEEN)
        total = np.maximum(counts.sum(axis=1, keepdims=True), 1)
        tokens = np.arange(counts.shape[1]) - token_split.MAX_TOKEN
        return cls(np.log2(total / often) + token_split.raw_lengths(tokens))

    def __getitem__(self, contexts: Int[np.ndarray, " c"]) -> LevelBits:
        """Give those of other contexts, each like one of these."""
        return LevelBits(self.table[contexts])

    def of(self, values: Int[np.ndarray, " m"], contexts: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Give the bits of each value in its context."""
        return np.asarray(self.table[contexts, token_split.split_tokens(values)[0] + token_split.MAX_TOKEN])


def fit_table(counts: Int[np.ndarray, " a"]) -> tuple[int, Int[np.ndarray, " b"]]:
    """Give the first token and the grades of a table for symbols of these counts."""
    seen = np.flatnonzero(counts)
    return int(seen[0]) - token_split.MAX_TOKEN, grades_of(counts[seen[0] : seen[-1] + 1])


def group_contexts(counts: Int[np.ndarray, "c a"]) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, "g a"]]:
    """Merge contexts, the most alike first, for as long as that saves bits, tables included.

    Returns:
        The group of each context (0 for a context that never occurs) and the counts of each group.
    """
    group_of = np.zeros(len(counts), np.int64)
    used = np.flatnonzero(counts.sum(axis=1))
    columns = np.flatnonzero(counts.sum(axis=0))  # most tokens never occur: leave them out of the arithmetic
    groups = counts[np.ix_(used, columns)].astype(np.float64)
    alive = np.ones(len(used), bool)
    leader = np.arange(len(used))
    bits = count_bits(groups)
    saving = np.full((len(used), len(used)), -np.inf)
    for row in range(len(used) - 1):
        saving[row, row + 1 :] = bits[row] + bits[row + 1 :] - count_bits(groups[row] + groups[row + 1 :])
    while alive.sum() > 1:
        best = int(np.argmax(saving))
        a, b = divmod(best, len(used))
        if saving[a, b] <= 0 and alive.sum() <= MAX_TABLES:
            break
        groups[a] += groups[b]
        bits[a] = count_bits(groups[a])
        alive[b] = False
        leader[leader == b] = a
        saving[b, :] = saving[:, b] = -np.inf
        fresh = bits[a] + bits - count_bits(groups[a] + groups)
        saving[a, a + 1 :] = np.where(alive[a + 1 :], fresh[a + 1 :], -np.inf)
        saving[:a, a] = np.where(alive[:a], fresh[:a], -np.inf)
    kept = np.flatnonzero(alive)
    group_of[used] = np.searchsorted(kept, leader)
    merged = np.zeros((len(kept), counts.shape[1]), np.int64)
    np.add.at(merged, group_of[used], counts[used])
    return group_of, merged
