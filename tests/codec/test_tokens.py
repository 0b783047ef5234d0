"""Tokens and raw bits."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.tokens import MAX_TOKEN, MAX_VALUE, join_tokens, pack_bits, raw_lengths, split_tokens, unpack_bits


@given(st.lists(st.integers(-MAX_VALUE, MAX_VALUE) | st.integers(-70, 70)))
def test_integers_come_back_from_tokens_and_bits(numbers):
    values = np.array(numbers, np.int64)
    tokens, raw = split_tokens(values)
    assert np.abs(tokens).max(initial=0) <= MAX_TOKEN
    lengths = raw_lengths(tokens)
    bits = np.unpackbits(np.frombuffer(pack_bits(raw, lengths), np.uint8))
    assert np.array_equal(join_tokens(tokens, unpack_bits(bits, 0, lengths)), values)


@given(st.lists(st.tuples(st.integers(0, 2**26 - 1), st.integers(0, 26))))
def test_bits_are_written_most_significant_first(pairs):
    """Against a string of binary digits."""
    pairs = [(value & ((1 << length) - 1), length) for value, length in pairs]
    digits = "".join(format(value, f"0{length}b") if length else "" for value, length in pairs)
    expected = bytes(int(digits[i : i + 8].ljust(8, "0"), 2) for i in range(0, len(digits), 8))
    columns = np.array(pairs, np.int64).reshape(-1, 2).T
    assert pack_bits(columns[0], columns[1]) == expected


def test_every_token_is_reached_in_order():
    values = np.unique(np.concatenate([np.arange(5000), (2 ** np.linspace(4, 27.99, 3000)).astype(np.int64)]))
    tokens, _ = split_tokens(values)
    assert np.array_equal(np.unique(np.diff(tokens)), [0, 1])
    assert tokens[-1] == MAX_TOKEN
