"""The codec's loops compiled, however little there is to do, or plain."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba  # noqa: F401  # compiled loops are only taken where it is loaded

from sacha_core.codec import adaptive, loops

__all__ = ["compiling"]

THRESHOLDS = [
    (module, name) for module in (adaptive, loops) for name in vars(module) if name.startswith("COMPILED_FROM")
]
ALL, NONE = 0, 1 << 40


@contextmanager
def compiling(compiled: bool) -> Iterator[None]:
    """Have everything run in compiled loops, or nothing, until the end of the block."""
    before = [getattr(module, name) for module, name in THRESHOLDS]
    try:
        for module, name in THRESHOLDS:
            setattr(module, name, ALL if compiled else NONE)
        yield
    finally:
        for (module, name), value in zip(THRESHOLDS, before, strict=True):
            setattr(module, name, value)
