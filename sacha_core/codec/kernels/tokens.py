"""Reading of token streams, compiled: the same integers as constriction's coder and the array operations of `tokens`.

Source: own; FORMAT.md, "Tokens", is the specification. Asymmetric numeral systems after Duda (2009).
"""

from __future__ import annotations

import numpy as np

from sacha_core.parallel.kernels.kernel import kernel

__all__ = ["FINE", "PRECISION_BITS", "QUICK_BITS", "take_raw", "take_tokens"]

PRECISION_BITS = 24  # of a probability
QUICK_BITS = 16  # where a search begins is listed by the highest bits alone
FINE = -1  # no table gave a token that it does not have
BELOW = np.uint64((1 << PRECISION_BITS) - 1)
PRECISION, QUICK, WORD = np.uint64(PRECISION_BITS), np.uint64(QUICK_BITS), np.uint64(32)
SHORT = np.uint64(1 << 32)


@kernel
def take_tokens(contexts, table_of, spans, lasts, begins, quick, firsts, words, registers, out):
    """Read a token for each context into `out`, those of a table together; `registers` are the state and the words left.

    Table t has the tokens from `firsts[t]` on, whose intervals begin at `begins[spans[t]]` and on, that of the last one at
    `begins[lasts[t]]`; `quick` (t, 256) says which is the first for the highest bits of a position. Gives the number of a table that a
    token lies beyond, or `FINE`.
    """
    n_tables = len(firsts)
    place = np.zeros(n_tables + 1, np.int64)
    for i in range(len(contexts)):
        place[table_of[contexts[i]] + 1] += 1
    for table in range(n_tables):
        place[table + 1] += place[table]
    order = np.empty(len(contexts), np.int64)
    for i in range(len(contexts)):
        table = table_of[contexts[i]]
        order[place[table]] = i
        place[table] += 1  # where the next table begins, in the end
    state, left = registers[0], np.int64(registers[1])
    start = 0
    for table in range(n_tables):
        base = spans[table]
        for k in range(start, place[table]):
            position = state & BELOW
            token = base + quick[table, np.int64(position >> QUICK)]
            while begins[token + 1] <= position:
                token += 1
            if token > lasts[table]:
                return table
            state = (state >> PRECISION) * (begins[token + 1] - begins[token]) + (position - begins[token])
            while state < SHORT and left > 0:
                left -= 1
                state = (state << WORD) | np.uint64(words[left])
            out[order[k]] = firsts[table] + (token - base)
        start = place[table]
    registers[0], registers[1] = state, np.uint64(left)
    return FINE


@kernel
def take_raw(values, bits, used, direct, mantissa_bits):
    """Turn tokens into integers in place, with the raw `bits` from `used` on; give how many are used then, -1 where they end too early."""
    octave = 1 << mantissa_bits
    for i in range(len(values)):
        token = abs(values[i])
        if token >= direct:
            beyond = token - direct
            length = beyond // octave + 4 - mantissa_bits
            if used + length > len(bits):
                return -1
            magnitude = octave + beyond % octave
            for k in range(used, used + length):
                magnitude = (magnitude << 1) | np.int64(bits[k])
            used += length
            values[i] = -magnitude if values[i] < 0 else magnitude
    return used
