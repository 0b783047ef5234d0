r"""Frequency tables: what the entropy coder knows of a kind of symbol, sent in the stream.

A table covers the tokens from `first` on; each token has a grade g from 0 to 63: g = 0 was never seen, otherwise its count was about
$2^{(g-1)/2}$. Weights are $\lfloor\sqrt{2^{g+7}}\rfloor$, integers from integers, so that both sides have the same to the last bit. Half an
octave of error in a probability costs 0.3 % of a bit rate, and a grade takes about two bits to send.

Source: own.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder
from sacha_core.codec.tokens import MAX_TOKEN
from sacha_core.errors import FormatError

__all__ = ["MAX_TABLES", "count_bits", "read_tables", "table_weights", "write_tables"]

MAX_TABLES = 64
MAX_GRADE = 63
WEIGHTS = np.array([1, *(math.isqrt(1 << (grade + 7)) for grade in range(1, MAX_GRADE + 1))], np.float64)
N_TOKENS = 2 * MAX_TOKEN + 1
EDGE_CONTEXT, GRADE_CONTEXT, CHOICE_CONTEXT = 0, 1, 2  # contexts of the adaptive integers that tables are written with
N_CONTEXTS = 3
BITS_PER_GRADE = 2.5  # measured; only steers how many tables an encoder makes
BITS_PER_TABLE = 16.0
GRADES_PER_BYTE = 3  # roughly; only steers by which loops they are read


def grades_of(counts: Int[np.ndarray, " a"]) -> Int[np.ndarray, " a"]:
    """Give the grade nearest to each count."""
    present = np.maximum(counts, 1)
    return np.where(counts > 0, 1 + np.rint(2 * np.log2(present)).astype(np.int64), 0)


def table_weights(grades: Int[np.ndarray, " a"]) -> Float[np.ndarray, " b"]:
    """Give the weights that the entropy coder takes; a table of one token gets a second that never comes."""
    weights = WEIGHTS[grades]
    return np.append(weights, 1.0) if len(weights) == 1 else weights


def count_bits(counts: Float[np.ndarray, "... a"]) -> Float[np.ndarray, "..."]:
    """Estimate the bits of coding symbols of these counts with a table of their own, the table included."""
    total = counts.sum(axis=-1)
    entropy = total * np.log2(np.maximum(total, 1)) - (counts * np.log2(np.maximum(counts, 1))).sum(axis=-1)
    return np.asarray(entropy + BITS_PER_GRADE * (counts > 0).sum(axis=-1) + BITS_PER_TABLE * (total > 0))


def write_tables(table_of: Int[np.ndarray, " c"], tables: list[tuple[int, Int[np.ndarray, "..."]]]) -> bytes:
    """Write which table each context uses, then the tables, each as its first token and its grades."""
    coder = AdaptiveEncoder(N_CONTEXTS, expected=len(table_of) + sum(len(grades) for _, grades in tables))
    coder.write(np.diff(table_of, prepend=0), np.full(len(table_of), CHOICE_CONTEXT))
    for first, grades in tables:
        steps = np.diff(grades, prepend=0)
        coder.write(np.array([first, len(grades)]), np.full(2, EDGE_CONTEXT))
        coder.write(steps, np.full(len(steps), GRADE_CONTEXT))
    return coder.finish()


def read_tables(
    data: bytes, n_contexts: int, n_tables: int, offset: int
) -> tuple[Int[np.ndarray, " c"], list[tuple[int, Int[np.ndarray, "..."]]]]:
    """Read what `write_tables` wrote.

    Raises:
        FormatError: a table is missing, reaches beyond the alphabet, or has a grade beyond its range.
    """
    coder = AdaptiveDecoder(data, N_CONTEXTS, expected=GRADES_PER_BYTE * len(data), offset=offset)
    table_of = np.cumsum(coder.read(np.full(n_contexts, CHOICE_CONTEXT)))
    if table_of.min(initial=0) < 0 or table_of.max(initial=0) >= max(n_tables, 1):
        raise FormatError(f"a context uses a table outside 0 to {n_tables - 1}", offset)
    tables = []
    for row in range(n_tables):
        first, length = (int(value) for value in coder.read(np.full(2, EDGE_CONTEXT)))
        if not (first >= -MAX_TOKEN and 1 <= length <= N_TOKENS and first + length - 1 <= MAX_TOKEN):
            raise FormatError(
                f"table {row} covers tokens {first} to {first + length - 1}, outside +-{MAX_TOKEN}", offset
            )
        grades = np.cumsum(coder.read(np.full(length, GRADE_CONTEXT)))
        if grades.min() < 0 or grades.max() > MAX_GRADE:
            raise FormatError(f"table {row} has a grade outside 0 to {MAX_GRADE}", offset)
        tables.append((first, grades))
    coder.check_end()
    return table_of, tables
