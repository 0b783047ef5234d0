"""Levels at real numbers: the four levels at 1 to 4, and nothing jumps or turns back between them."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.codec.levels import ATTRIBUTES, LEVELS, MAX_QUALITY, MIN_QUALITY, level_at
from sacha_core.codec.steps import MAX_EXPONENT, PER_OCTAVE, STEPS
from sacha_core.errors import OptionError

QUALITIES = np.linspace(MIN_QUALITY, MAX_QUALITY, 701)


def test_whole_numbers_are_the_four_levels():
    for number, level in LEVELS.items():
        assert level_at(number) == level
        assert level.number == number
        assert level.exponents == (PER_OCTAVE * (2 - number),) * len(ATTRIBUTES)


def test_everything_becomes_finer_as_quality_grows():
    levels = [level_at(quality) for quality in QUALITIES]
    for name in ("expression_step", "shape_step", "angle_step_rad", "translation_step", "offset_step"):
        assert (np.diff([getattr(level, name) for level in levels]) <= 1e-12).all()
    for name in ("opacity_steps", "max_thinness", "number"):
        assert (np.diff([getattr(level, name) for level in levels]) >= 0).all()
    moved = np.diff([level.exponents for level in levels], axis=0)
    assert (moved <= 0).all()
    assert (moved.sum(axis=1) >= -2).all()  # attributes move one by one, not all at once


@pytest.mark.parametrize("quality", [MIN_QUALITY - 0.01, MAX_QUALITY + 0.01, np.nan])
def test_no_level_beyond_the_ends(quality):
    with pytest.raises(OptionError, match="outside"):
        level_at(quality)


def test_steps_are_the_powers_of_two_rounded_down():
    """Oracle: the power of the platform's libm, which is far from a whole number but where it is one."""
    power = 2.0 ** (np.arange(MAX_EXPONENT + 1) / PER_OCTAVE)
    assert np.array_equal(STEPS, np.floor(power * (1 + 1e-13)))
