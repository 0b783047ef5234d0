"""Harmonics in other axes. Oracle: a rotation of everything, camera too, changes no colour."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sacha_core.raster.harmonic_turns import turned_harmonics
from sacha_core.raster.harmonics import sh_colours

RNG = np.random.default_rng(3)
ROUNDING = 2e-6  # of sums of fifteen float32 products of order 1
EXACTNESS = 1e-12  # of 64 equations in float64


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_turning_everything_changes_no_colour(degree: int) -> None:
    n, k = 200, (degree + 1) ** 2 - 1
    rotation = Rotation.random(random_state=degree).as_matrix()
    dc, rest = np.full((n, 3), 2.0, np.float32), RNG.normal(0, 0.2, (n, k, 3)).astype(np.float32)
    means, centre = RNG.normal(0, 1, (n, 3)), np.array([0.3, -2.0, 5.0])
    before = sh_colours(dc, rest, means, centre, degree)
    after = sh_colours(dc, turned_harmonics(rest, rotation), means @ rotation.T, rotation @ centre, degree)
    assert before.min() > 0  # nothing was cut
    np.testing.assert_allclose(after, before, atol=ROUNDING)


def test_turns_follow_one_another() -> None:
    one, two = Rotation.random(2, random_state=7).as_matrix()
    rest = RNG.normal(0, 1, (5, 15, 3))
    np.testing.assert_allclose(
        turned_harmonics(turned_harmonics(rest, one), two), turned_harmonics(rest, two @ one), atol=EXACTNESS
    )
    np.testing.assert_allclose(turned_harmonics(rest, np.eye(3)), rest, atol=EXACTNESS)
