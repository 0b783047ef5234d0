"""Oracle: exact round trips, the entropy of a known distribution, and the plain loops for the compiled ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.adaptive import compiled_kernels
from sacha_core.codec.kernels import residuals as loops
from sacha_core.codec.residuals import MORE, ZERO, encode_residuals, first_registers, fresh_models

OVER_ENTROPY = (
    1.015  # of 20,000 integers of the class they are in: what learning costs, and three digits of the coder's range
)
TABLE_ERROR = 0.5  # of a probability in 65,536ths that was rounded

integers = st.integers(-(2**31) + 1, 2**31 - 1) | st.integers(-40, 40)
rows = st.lists(st.tuples(integers, st.integers(0, loops.CLASSES - 1)), max_size=60)


def read(data: bytes, kinds: np.ndarray) -> tuple[list[int], int]:
    """Read with the plain loops; give the integers and how many bytes were looked at."""
    registers, models = first_registers(data), fresh_models()
    values = [loops.take_residual(registers, data, models, kind) for kind in kinds.tolist()]
    return values, registers[2]


@given(rows)
def test_integers_come_back_and_no_byte_is_unread(pairs):
    values = np.array([pair[0] for pair in pairs], np.int64)
    kinds = np.array([pair[1] for pair in pairs], np.int64)
    data = encode_residuals(values, kinds, compiled=False)
    back, n_read = read(data, kinds)
    assert back == values.tolist()
    assert n_read >= len(data)


@pytest.mark.parametrize("spread", [0.05, 1.0, 9.0, 4000.0])
def test_compiled_and_plain_agree_to_the_bit(spread):
    if compiled_kernels() is None:
        pytest.skip("Numba is not installed; the plain loops are all there is")
    rng = np.random.default_rng(int(spread * 100))
    values = np.rint(rng.laplace(0, spread, 3000)).astype(np.int64)
    kinds = rng.integers(0, loops.CLASSES, 3000)
    assert encode_residuals(values, kinds, compiled=True) == encode_residuals(values, kinds, compiled=False)


def ratio_of(mean_magnitude: float) -> float:
    """Ratio of the two-sided geometric distribution of a mean magnitude: 2 r / (1 - r^2) = m."""
    return (np.sqrt(1 + mean_magnitude**2) - 1) / mean_magnitude


def test_tables_are_those_of_the_distribution():
    """Closed form: P(0) = (1 - r) / (1 + r), P(k | at least k) = 1 - r; of halves, P(0) + 2 P(1) and 1 - r^2."""
    for kind in range(loops.FIRST_SHIFTED):
        r = ratio_of(2 ** (kind / 2 + 0.25) / 64)
        assert abs(ZERO[kind] - 65536 * (1 - r) / (1 + r)) <= TABLE_ERROR
        assert abs(MORE[kind] - 65536 * (1 - r)) <= TABLE_ERROR
    for kind in range(loops.FIRST_SHIFTED, len(ZERO)):
        r = ratio_of(2 ** (kind / 2 + 0.25) / 64)
        assert abs(ZERO[kind] - 65536 * (1 - 2 * r**2 / (1 + r))) <= TABLE_ERROR
        assert abs(MORE[kind] - 65536 * (1 - r**2)) <= TABLE_ERROR


@pytest.mark.parametrize("kind", [4, 9, 12, 15, 20, 27])
def test_the_first_guess_is_close_to_the_entropy(kind):
    r = ratio_of(2 ** (kind / 2 + 0.25) / 64)
    rng = np.random.default_rng(kind)
    values = rng.geometric(1 - r, 20_000) - rng.geometric(1 - r, 20_000)  # their difference is distributed so
    magnitude = np.abs(values)
    bits = -np.log2((1 - r) / (1 + r)) - magnitude * np.log2(r)
    assert len(encode_residuals(values, np.full(20_000, kind))) < OVER_ENTROPY * bits.sum() / 8


def test_nothing_where_nothing_is_expected_costs_next_to_nothing():
    assert len(encode_residuals(np.zeros(10_000, np.int64), np.zeros(10_000, np.int64))) < 30


@pytest.mark.parametrize("seed", range(20))
def test_any_bytes_give_integers_or_what_no_encoder_writes(seed):
    rng = np.random.default_rng(seed)
    data = rng.integers(0, 256, rng.integers(0, 60), dtype=np.uint8).tobytes() if seed else b"\xff" * 400
    values, _ = read(data, rng.integers(0, loops.CLASSES, 300))
    assert max(map(abs, values)) <= loops.MASK << 17
