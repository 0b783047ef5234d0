"""Torch on one thread, as the bench has it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from sacha_core.bench.exact import one_thread


@pytest.fixture(scope="session", autouse=True)
def _torch_on_one_thread() -> Iterator[None]:
    with one_thread():
        yield
