"""What Gaussians promise towards a goal. Oracle: a codec in closed form, whose bytes and errors are exactly as they are thought to be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.levels import MAX_QUALITY, MIN_QUALITY
from sacha_core.rate.goal import FITTED, Measured, SameQuality, SameSize
from sacha_core.rate.target import DB_PER_LEVEL, LOG_BYTES_PER_LEVEL


@dataclass(frozen=True)
class Codec:
    """Takes `size` bytes and makes an error of `rounding` at quality 0, beside what is missing."""

    size: float
    rounding: float
    missing: float

    def bytes_at(self, quality: float) -> float:
        return self.size * math.exp(LOG_BYTES_PER_LEVEL * quality)

    def error_at(self, quality: float, fitted: float = 1.0) -> float:
        return self.missing + fitted * self.rounding * 10 ** (-DB_PER_LEVEL * quality / 10)

    def measured(self, quality: float) -> Measured:
        coded = -10 * math.log10(self.error_at(quality))
        return Measured(quality, self.bytes_at(quality), -10 * math.log10(self.missing), coded)  # type: ignore[arg-type]


codecs = st.builds(Codec, st.floats(1e3, 1e5), st.floats(1e-4, 1e-2), st.floats(1e-7, 1e-4))


@given(codecs, st.floats(0, 4), st.floats(0, 4))
def test_quality_is_promised_at_the_level_that_gives_it(codec: Codec, at: float, wanted: float) -> None:
    goal = SameQuality(-10 * math.log10(codec.error_at(wanted, FITTED)))
    found = goal.prospect(codec.measured(at))
    assert found.quality == pytest.approx(wanted, abs=1e-4)  # what is missing was taken away from nearly as much
    assert found.cost == pytest.approx(math.log(codec.bytes_at(wanted)), abs=1e-4)


@given(codecs, st.floats(0, 4), st.floats(0, 4))
def test_size_is_promised_at_the_level_that_takes_it(codec: Codec, at: float, wanted: float) -> None:
    found = SameSize(codec.bytes_at(wanted)).prospect(codec.measured(at))  # type: ignore[arg-type]
    assert found.quality == pytest.approx(wanted, abs=1e-6)
    assert found.cost == pytest.approx(codec.error_at(wanted, FITTED), rel=1e-4)


def test_what_is_out_of_reach_costs_without_end() -> None:
    codec = Codec(1e4, 1e-3, 1e-4)
    assert math.isinf(SameQuality(41.0).prospect(codec.measured(2)).cost)  # what is missing alone is 40 dB
    assert math.isinf(SameQuality(39.99999).prospect(codec.measured(2)).cost)  # no level is so fine
    assert math.isinf(SameSize(10).prospect(codec.measured(2)).cost)
    assert SameSize(10).prospect(codec.measured(2)).quality == MIN_QUALITY
    roomy = SameSize(10**9).prospect(codec.measured(2))
    assert roomy.quality == MAX_QUALITY
    assert not math.isinf(roomy.cost)


def test_same_pictures_leave_nothing_to_promise() -> None:
    found = SameQuality(40.0).prospect(Measured(2.0, 1000, 120.0, 120.0))
    assert found.quality == MIN_QUALITY
    assert math.isfinite(found.cost)
