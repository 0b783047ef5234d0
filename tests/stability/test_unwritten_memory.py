"""Memory that nobody has written yet decides nothing: training gives the same bytes whatever it held."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sacha_core.bench.stability.determinism import ITERATIONS, _expected, _files
from sacha_core.bench.stability.tiny import eventful
from sacha_core.parallel.buffers import Buffers

NOT_A_NUMBER, HUGE = 0xFF, 0x7E  # bytes of float32: NaN, and 8.5e37


@pytest.mark.parametrize("variant", ["sacha", "default"])
@pytest.mark.parametrize("byte", [NOT_A_NUMBER, HUGE])
def test_left_over_memory_changes_nothing(variant: str, byte: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Metamorphic: fresh arrays and space used again are filled with garbage whenever they are handed out."""
    expected = _expected(variant)  # compiles, which has to happen before NumPy is tampered with
    handed_out = 0
    space, empty, empty_like = Buffers.space, np.empty, np.empty_like

    def filled(array: np.ndarray) -> np.ndarray:
        nonlocal handed_out
        if array.dtype.kind in "fiu" and array.size:
            handed_out += 1
            array.reshape(-1).view(np.uint8)[:] = byte
        return array

    def garbage_space(self: Buffers, *args: Any) -> np.ndarray:
        return filled(space(self, *args))

    monkeypatch.setattr(Buffers, "space", garbage_space)
    monkeypatch.setattr(np, "empty", lambda *args, **options: filled(empty(*args, **options)))
    monkeypatch.setattr(np, "empty_like", lambda *args, **options: filled(empty_like(*args, **options)))
    for threads in (1, 2):
        assert _files(replace(eventful(ITERATIONS, variant), threads=threads)) == expected
    assert handed_out > 10 * ITERATIONS
