"""The learning-rate curve against its formula."""

from __future__ import annotations

import pytest

from sacha_core.train.rates import position_rate


def test_the_position_rate_falls_log_linearly_and_stays() -> None:
    assert position_rate(5e-3, 5e-5, 0, 1000) == pytest.approx(5e-3, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 500, 1000) == pytest.approx(5e-4, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 1000, 1000) == pytest.approx(5e-5, rel=1e-12)
    assert position_rate(5e-3, 5e-5, 9999, 1000) == pytest.approx(5e-5, rel=1e-12)
