"""Residuals: integers of an expected size, coded by adaptive binary models that begin where a distribution of that size would put them.

The loops are in `kernels/residuals.py`. FORMAT.md, "Residuals", is the specification.

Source: own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Int

from sacha_core.codec.adaptive import SLACK_BYTES, WORST_BYTES, Kernels, kernels_for, last_bytes
from sacha_core.codec.kernels import arithmetic, residuals

__all__ = ["MORE", "ZERO", "encode_residuals", "first_registers", "fresh_models"]

PLAIN: Kernels = {"encode_residuals": residuals.encode_residuals}

# Of a two-sided geometric distribution whose mean magnitude is 2^(class / 2 + 1/4) / 64, in 65,536ths: the probability that the
# magnitude (of the last two rows: half of it, as of all later classes) is 0, and that it is k where it is at least k > 0.
ZERO = (
    64330, 63836, 63146, 62182, 60846, 59008, 56514, 53191, 48887, 43539, 37278, 30518, 23892, 18012, 13217, 9536, 17875, 13199,
)  # fmt: skip
MORE = (
    64927, 64675, 64319, 63815, 63104, 62101, 60692, 58722, 56000, 52319, 47524, 41644, 35018, 28258, 21997, 16649, 22364, 16802,
)  # fmt: skip


def fresh_models() -> list[int]:
    """Give the models as they are before the first residual."""
    models: list[int] = []
    for kind in range(residuals.CLASSES):
        row = kind if kind < len(ZERO) else residuals.FIRST_SHIFTED + (kind & 1)
        for probability in (ZERO[row], *[MORE[row]] * (residuals.UNARY_BINS - 1)):
            models += [probability, residuals.SEEN_AT_FIRST]
    return models + [arithmetic.ONE // 2, residuals.SEEN_AT_FIRST] * residuals.LENGTH_BINS


def first_registers(data: bytes) -> list[int]:
    """Give the registers of a decoder that begins to read `data`."""
    return [int.from_bytes(data[:4].ljust(4, b"\0"), "big"), arithmetic.MASK, 4]


def encode_residuals(
    values: Int[np.ndarray, " m"], kinds: Int[np.ndarray, " m"], expected: int = 0, compiled: bool | None = None
) -> bytes:
    """Code `values`, each under its class.

    Args:
        values: of at most 32 bits.
        kinds: classes.
        expected: roughly how many integers the caller codes in all: decides whether compiling pays.
        compiled: force compiled (True) or plain (False) loops; for tests.
    """
    kernels = kernels_for(max(expected, len(values)), compiled)
    registers: Any = [0, arithmetic.MASK, -1, 0, 0]
    room = len(values) * WORST_BYTES + SLACK_BYTES
    if kernels:
        registers, out, models = np.array(registers), np.zeros(room, np.uint8), np.array(fresh_models())
        kernels["encode_residuals"](
            registers, out, models, np.ascontiguousarray(values, np.int64), np.ascontiguousarray(kinds, np.int64)
        )
        coded = out[: int(registers[4])].tobytes()
    else:
        plain = bytearray(room)
        PLAIN["encode_residuals"](registers, plain, fresh_models(), values.tolist(), kinds.tolist())
        coded = bytes(plain[: registers[4]])
    return (coded + last_bytes(registers)).rstrip(b"\0")
