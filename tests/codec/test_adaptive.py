"""Adaptive integers: exact round trips, near the entropy, compiled and plain alike."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.adaptive import AdaptiveDecoder, AdaptiveEncoder, compiled_kernels
from sacha_core.errors import FormatError

N_CONTEXTS = 3
OVER_ENTROPY = 1.02  # learning the probabilities of 16 bins costs about 1 % of 30,000 integers

integers = st.integers(-(2**32) + 1, 2**32 - 1) | st.integers(-20, 20)
rows = st.lists(st.tuples(integers, st.integers(0, N_CONTEXTS - 1)), max_size=60)


def encode(values: np.ndarray, contexts: np.ndarray, compiled: bool = False) -> bytes:
    coder = AdaptiveEncoder(N_CONTEXTS, compiled=compiled)
    half = len(values) // 2
    coder.write(values[:half], contexts[:half])
    coder.write(values[half:], contexts[half:])
    return coder.finish()


@given(rows)
def test_integers_come_back(pairs):
    values = np.array([pair[0] for pair in pairs], np.int64)
    contexts = np.array([pair[1] for pair in pairs], np.int64)
    decoder = AdaptiveDecoder(encode(values, contexts), N_CONTEXTS, compiled=False)
    half = len(values) // 2
    back = np.concatenate([decoder.read(contexts[:half]), decoder.read(contexts[half:])])
    decoder.check_end()
    assert np.array_equal(back, values)


@pytest.mark.parametrize("spread", [0.1, 1.0, 8.0, 3000.0])
def test_compiled_and_plain_agree_to_the_bit(spread):
    if compiled_kernels() is None:
        pytest.skip("Numba is not installed; the plain loops are all there is")
    rng = np.random.default_rng(int(spread * 10))
    values = np.rint(rng.laplace(0, spread, 4000)).astype(np.int64)
    contexts = rng.integers(0, N_CONTEXTS, 4000)
    plain, compiled = encode(values, contexts), encode(values, contexts, compiled=True)
    assert plain == compiled
    half = len(values) // 2
    for loops in (False, True):
        decoder = AdaptiveDecoder(plain, N_CONTEXTS, compiled=loops)
        back = np.concatenate([decoder.read(contexts[:half]), decoder.read(contexts[half:])])
        decoder.check_end()
        assert np.array_equal(back, values)


def test_coder_is_close_to_the_entropy():
    values = np.rint(np.random.default_rng(5).laplace(0, 2, 30_000)).astype(np.int64)
    counts = np.unique(values, return_counts=True)[1]
    entropy_bytes = -(counts * np.log2(counts / len(values))).sum() / 8
    assert entropy_bytes < len(encode(values, np.zeros_like(values))) < OVER_ENTROPY * entropy_bytes


def test_a_constant_costs_next_to_nothing():
    values = np.zeros(10_000, np.int64)
    assert len(encode(values, values)) < 20


@pytest.mark.parametrize("seed", range(20))
def test_any_bytes_decode_or_are_refused(seed):
    rng = np.random.default_rng(seed)
    data = rng.integers(0, 256, rng.integers(0, 40), dtype=np.uint8).tobytes()
    decoder = AdaptiveDecoder(data, N_CONTEXTS, compiled=False)
    try:
        values = decoder.read(np.zeros(200, np.int64))
    except FormatError:
        return
    assert np.abs(values).max() < 2**34


def test_endless_suffix_is_refused():
    with pytest.raises(FormatError, match="suffix"):
        AdaptiveDecoder(b"\xff" * 400, N_CONTEXTS, compiled=False).read(np.zeros(400, np.int64))


def test_bytes_left_over_are_refused():
    coded = encode(np.arange(50), np.zeros(50, np.int64))
    decoder = AdaptiveDecoder(coded + b"x" * 9, N_CONTEXTS, compiled=False)
    decoder.read(np.zeros(25, np.int64))
    with pytest.raises(FormatError, match="left over"):
        decoder.check_end()
