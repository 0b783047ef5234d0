"""Streams of integers under contexts: exact, close to the entropy, as specified, and safe against any bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_coder import StackDecoder, cumulative

from sacha_core.codec.reading import ByteReader
from sacha_core.codec.symbols import SymbolReader, SymbolWriter
from sacha_core.codec.tables import read_tables
from sacha_core.codec.tokens import MAX_VALUE
from sacha_core.errors import FormatError

N_CONTEXTS = 6
OVER_ENTROPY = 1.015  # grades of half an octave cost 0.3 %, three tables of this stream 0.3 %


def encode(batches: list[tuple[np.ndarray, np.ndarray]]) -> bytes:
    writer = SymbolWriter(N_CONTEXTS)
    for values, contexts in batches:
        writer.write(values, contexts)
    return writer.finish()


@given(st.lists(st.tuples(st.integers(-MAX_VALUE, MAX_VALUE) | st.integers(-3, 3), st.integers(0, 5)), max_size=80))
def test_integers_come_back(pairs):
    values = np.array([pair[0] for pair in pairs], np.int64)
    contexts = np.array([pair[1] for pair in pairs], np.int64)
    cut = len(pairs) // 3
    data = encode([(values[:cut], contexts[:cut]), (values[cut:], contexts[cut:])])
    reader = SymbolReader(ByteReader(data, "x"), N_CONTEXTS)
    back = np.concatenate([reader.read(contexts[:cut]), reader.read(contexts[cut:])])
    reader.check_end()
    assert np.array_equal(back, values)


def laplace_stream(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    contexts = rng.integers(0, N_CONTEXTS, n)
    return np.rint(rng.laplace(0, 0.6 * 3.0 ** (contexts // 2))).astype(np.int64), contexts


def test_coder_is_close_to_the_entropy():
    values, contexts = laplace_stream(60_000)
    entropy_bits = 0.0
    for group in range(3):
        counts = np.unique(values[contexts // 2 == group], return_counts=True)[1]
        entropy_bits -= (counts * np.log2(counts / counts.sum())).sum()
    size = len(encode([(values, contexts)]))
    assert entropy_bits / 8 < size < OVER_ENTROPY * entropy_bits / 8


def test_contexts_alike_share_a_table():
    values, contexts = laplace_stream(60_000)
    data = encode([(values, contexts)])
    reader = ByteReader(data, "x")
    n_tables, table_bytes, _ = reader.unpack("BII")
    table_of, _ = read_tables(reader.take(table_bytes), N_CONTEXTS, n_tables, 0)
    assert table_of.tolist() == [0, 0, 1, 1, 2, 2]


def test_words_are_what_the_specification_says():
    """Oracle: a decoder in plain Python, written from FORMAT.md."""
    values, contexts = laplace_stream(800)
    data = encode([(np.clip(values, -15, 15), contexts)])
    reader = ByteReader(data, "x")
    n_tables, table_bytes, bit_bytes = reader.unpack("BII")
    table_of, tables = read_tables(reader.take(table_bytes), N_CONTEXTS, n_tables, 0)
    assert bit_bytes == 0
    decoder = StackDecoder(np.frombuffer(reader.take(reader.left), "<u4").tolist())
    expected = np.zeros(len(values), np.int64)
    for table, (first, grades) in enumerate(tables):
        ends = cumulative(grades.tolist())
        for row in np.flatnonzero(table_of[contexts] == table):
            expected[row] = first + decoder.decode(ends)
    assert decoder.state == 0
    assert not decoder.words
    assert np.array_equal(expected, np.clip(values, -15, 15))


def attempt(data: bytes, n: int) -> None:
    """Decode; only FormatError may be raised."""
    try:
        reader = SymbolReader(ByteReader(data, "x"), N_CONTEXTS)
        reader.read(np.arange(n) % N_CONTEXTS)
        reader.check_end()
    except FormatError:
        pass


def test_any_change_decodes_or_is_refused():
    values, contexts = laplace_stream(300)
    data = encode([(values, contexts)])
    rng = np.random.default_rng(3)
    for _ in range(300):
        changed = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 4)):
            changed[at] = rng.integers(0, 256)
        attempt(bytes(changed[: rng.integers(0, len(data) + 1)] if rng.random() < 0.3 else changed), 300)


@pytest.mark.parametrize("n_bytes", [0, 1, 8, 9, 10, 50, 400])
def test_random_bytes_decode_or_are_refused(n_bytes):
    data = np.random.default_rng(n_bytes).integers(0, 256, n_bytes, dtype=np.uint8).tobytes()
    attempt(data, 100)


def test_cut_words_are_noticed():
    contexts = np.zeros(500, np.int64)
    data = encode([(np.arange(500) % 7, contexts)])
    reader = SymbolReader(ByteReader(data[:-40] + data[-16:], "x"), N_CONTEXTS)
    reader.read(contexts)
    with pytest.raises(FormatError, match="left over, or were cut"):
        reader.check_end()


def test_symbol_beyond_the_range_is_refused_by_the_encoder():
    with pytest.raises(FormatError, match="steps off its prediction"):
        SymbolWriter(1).write(np.array([MAX_VALUE + 1]), np.zeros(1, np.int64))


def test_bits_of_levels_add_up_to_the_stream():
    """Oracle: the stream itself, without its tables, which say the same to half an octave."""
    values, contexts = laplace_stream(60_000)
    writer = SymbolWriter(N_CONTEXTS)
    writer.write(values, contexts)
    data = writer.finish()
    n_tables, table_bytes, _ = ByteReader(data, "x").unpack("BII")
    expected = writer.level_bits().of(values, contexts).sum() / 8
    assert n_tables == 3
    assert abs(len(data) - table_bytes - expected) < (OVER_ENTROPY - 1) * expected
