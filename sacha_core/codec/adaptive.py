"""Adaptive integers: the context-adaptive binary arithmetic coder of motion, counts and tables.

The loops are in `kernels/arithmetic.py`. Short work runs as plain Python; longer work compiled, where Numba is installed, and sooner
where it is in use already: the bytes are the same either way.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Int

from sacha_core.codec.kernels import arithmetic
from sacha_core.errors import FormatError

__all__ = ["AdaptiveDecoder", "AdaptiveEncoder", "Kernels", "compiled_kernels", "kernels_for", "last_bytes"]

COMPILED = "sacha_core.codec.kernels.compiled"
COMPILED_FROM_LOADED = 40  # where the compiled loops are there already
COMPILED_FROM = 200_000  # below this, plain Python is done before Numba is imported
COMPILED_FROM_WITH_NUMBA = (
    1000  # where it is imported already; below this, plain Python is done before the loops come from the cache
)
WORST_BYTES = 70  # an integer below 2**32 takes at most 50 modelled bins of up to 10.1 bits, and 31 even ones
SLACK_BYTES = 16

Kernels = dict[str, Callable[..., Any]]
PLAIN: Kernels = {name: getattr(arithmetic, name) for name in ("encode_integers", "decode_integers", "shift_low")}


@cache
def compiled_kernels() -> Kernels | None:
    """Give the coder's loops compiled by Numba, or None where it is not installed."""
    if importlib.util.find_spec("numba") is None:
        return None
    from sacha_core.codec.kernels import compiled  # noqa: PLC0415  # Numba takes longer to import than most files to decode

    return {name: getattr(compiled, name) for name in compiled.__all__}


def kernels_for(n_integers: int, compiled: bool | None) -> Kernels | None:
    """Choose the loops for a job of so many integers; None stands for plain Python."""
    if compiled is None:
        enough = COMPILED_FROM_WITH_NUMBA if "numba" in sys.modules else COMPILED_FROM
        compiled = n_integers >= (COMPILED_FROM_LOADED if COMPILED in sys.modules else enough)
    return compiled_kernels() if compiled else None


def fresh_models(n_contexts: int) -> list[int]:
    """Give models that hold both values of every bin for equally likely."""
    return [arithmetic.ONE // 2, arithmetic.ONE // 2, 0] * (n_contexts * arithmetic.ACTIVITY_CLASSES * arithmetic.BINS)


def last_bytes(registers: Sequence[int] | Int[np.ndarray, "5"]) -> bytes:
    """Give the bytes that an encoder with these registers still owes."""
    low, width, cached, pending, _ = (int(register) for register in registers)
    for bits in range(31, -1, -1):  # the number with the most trailing zeros inside the last interval
        rounded = (low + (1 << bits) - 1) >> bits << bits
        if rounded < low + width:
            low = rounded
            break
    owing = [low, width, cached, pending, 0]
    out = bytearray(pending + SLACK_BYTES)
    for _ in range(5):
        PLAIN["shift_low"](owing, out)
    return bytes(out[: owing[4]])


class AdaptiveEncoder:
    """Codes signed integers of at most 32 bits, each under a context, into bytes.

    Args:
        n_contexts: contexts run from 0 to n_contexts - 1.
        expected: roughly how many integers are to come: decides whether compiling pays.
        compiled: force compiled (True) or plain (False) loops; for tests.
    """

    def __init__(self, n_contexts: int, expected: int = 0, compiled: bool | None = None) -> None:
        self._kernels = kernels_for(expected, compiled)
        self._models: Any = fresh_models(n_contexts)
        self._registers: Any = [0, arithmetic.MASK, -1, 0, 0]
        if self._kernels:
            self._models = np.array(self._models, np.int64)
            self._registers = np.array(self._registers, np.int64)
        self._parts: list[bytes] = []

    def write(self, values: Int[np.ndarray, " m"], contexts: Int[np.ndarray, " m"]) -> None:
        """Code `values`, each under its context."""
        room = len(values) * WORST_BYTES + SLACK_BYTES + int(self._registers[3])
        out: Any = np.zeros(room, np.uint8) if self._kernels else bytearray(room)
        self._registers[4] = 0
        if self._kernels:
            wide = np.ascontiguousarray(values, np.int64), np.ascontiguousarray(contexts, np.int64)
            self._kernels["encode_integers"](self._registers, out, self._models, *wide)
        else:
            PLAIN["encode_integers"](self._registers, out, self._models, values.tolist(), contexts.tolist())
        self._parts.append(bytes(out[: int(self._registers[4])]))

    def finish(self) -> bytes:
        """Give all bytes; trailing zeros are left out, since the decoder reads zeros past the end."""
        self._parts.append(last_bytes(self._registers))
        return b"".join(self._parts).rstrip(b"\0")


class AdaptiveDecoder:
    """Reads what `AdaptiveEncoder` wrote, given the same contexts.

    Args:
        data: the coded bytes.
        n_contexts: as the encoder's.
        expected: roughly how many integers will be read.
        compiled: force compiled (True) or plain (False) loops; for tests.
        offset: where `data` lies in its file, for messages.
    """

    def __init__(
        self, data: bytes, n_contexts: int, expected: int = 0, compiled: bool | None = None, offset: int | None = None
    ) -> None:
        self._kernels = kernels_for(expected, compiled)
        self._data: Any = data
        self._offset = offset
        self._models: Any = fresh_models(n_contexts)
        self._registers: Any = [int.from_bytes(data[:4].ljust(4, b"\0"), "big"), arithmetic.MASK, 4]
        if self._kernels:
            self._data = np.frombuffer(data, np.uint8)
            self._models = np.array(self._models, np.int64)
            self._registers = np.array(self._registers, np.int64)

    def read(self, contexts: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Read one integer for each context.

        Raises:
            FormatError: an integer has more digits than an encoder writes.
        """
        if self._kernels:
            values = np.zeros(len(contexts), np.int64)
            wide = np.ascontiguousarray(contexts, np.int64)
            fine = self._kernels["decode_integers"](self._registers, self._data, self._models, values, wide)
        else:
            plain = [0] * len(contexts)
            fine = PLAIN["decode_integers"](self._registers, self._data, self._models, plain, contexts.tolist())
            values = np.array(plain, np.int64)
        if not fine:
            raise self.error("a suffix of more than 32 bits, which no encoder writes")
        return values

    def error(self, message: str) -> FormatError:
        """Give (not raise) the error that `message` describes."""
        return FormatError(f"adaptive integers: {message}", self._offset)

    def check_end(self) -> None:
        """Check that the bytes were used up.

        Raises:
            FormatError: some of them were never needed.
        """
        if len(self._data) > int(self._registers[2]):
            unused = len(self._data) - int(self._registers[2])
            raise self.error(f"{unused} bytes are left over")
