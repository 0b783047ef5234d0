"""Spherical harmonics against SciPy, and their gradients against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import sph_harm_y

from sacha_core.errors import OptionError
from sacha_core.raster.harmonics import sh_colours, sh_colours_backward
from sacha_core.raster.pool import Pool

EXACT = 1e-12  # float64, sums of sixteen terms of order one
SINGLE = 2e-6  # the same in float32
DIFFERENCE = 1e-7  # relative; central differences of step 1e-5 in float64


def inputs(n: int = 40, coefficients: int = 15, seed: int = 0, dtype: type = np.float64) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    shapes = ((n, 3), (n, coefficients, 3), (n, 3), (3,))
    return tuple(rng.normal(size=shape).astype(dtype) for shape in shapes)


def real_harmonics(directions: np.ndarray) -> np.ndarray:
    """Give SciPy's sixteen real harmonics, in the order of degree and then of order -l to l."""
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.real if order >= 0 else value.imag
            columns.append(part * (np.sqrt(2) if order else 1))
    return np.stack(columns, 1)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_colours_are_those_of_scipy(degree: int) -> None:
    sh_dc, sh_rest, means, centre = inputs()
    directions = (means - centre) / np.linalg.norm(means - centre, axis=1, keepdims=True)
    basis = real_harmonics(directions)[:, : (degree + 1) ** 2]
    coefficients = np.concatenate([sh_dc[:, None], sh_rest], 1)[:, : basis.shape[1]]
    expected = np.maximum(np.einsum("nk,nkc->nc", basis, coefficients) + 0.5, 0)
    assert np.abs(sh_colours(sh_dc, sh_rest, means, centre, degree) - expected).max() < EXACT
    assert (expected == 0).any()  # the cut is on trial too


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_gradients_are_finite_differences(degree: int) -> None:
    arrays = list(inputs(n=6, seed=3))
    upstream = np.random.default_rng(1).normal(size=(6, 3))
    gradients = sh_colours_backward(*arrays, degree, upstream)
    for which, gradient in enumerate(gradients):
        numeric = np.zeros_like(gradient)
        for at in np.ndindex(gradient.shape):
            ends = []
            for step in (1e-5, -1e-5):
                moved = [a.copy() for a in arrays]
                moved[which][at] += step
                ends.append((sh_colours(*moved, degree) * upstream).sum())
            numeric[at] = (ends[0] - ends[1]) / 2e-5
        assert np.abs(gradient - numeric).max() < DIFFERENCE * max(np.abs(numeric).max(), 1)


def test_float32_is_precise_and_threads_do_not_matter() -> None:
    exact = inputs(n=301)
    single = [a.astype(np.float32) for a in exact]
    upstream = np.ones((301, 3))
    pool = Pool(3)
    alone, shared = sh_colours(*single, 3), sh_colours(*single, 3, pool)
    assert alone.dtype == np.float32
    assert np.array_equal(alone, shared)
    assert np.abs(alone - sh_colours(*(a.astype(np.float64) for a in single), 3)).max() < 10 * SINGLE
    wide = sh_colours_backward(*(a.astype(np.float64) for a in single), 3, upstream)
    for one, other, reference in zip(
        sh_colours_backward(*single, 3, upstream), sh_colours_backward(*single, 3, upstream, pool), wide, strict=True
    ):
        assert np.array_equal(one, other)
        assert np.abs(one - reference).max() < 10 * SINGLE * np.abs(reference).max()


def test_direction_that_does_not_exist_stays_finite_and_a_broken_coefficient_does_not_hide() -> None:
    sh_dc, sh_rest, means, centre = inputs(n=4)
    means[0], means[1], means[2, 1] = centre, np.nan, np.inf
    assert np.isfinite(sh_colours(sh_dc, sh_rest, means, centre, 3)).all()
    for gradient in sh_colours_backward(sh_dc, sh_rest, means, centre, 3, np.ones((4, 3))):
        assert np.isfinite(gradient).all()
    sh_dc[3, 1] = np.nan
    assert np.isnan(sh_colours(sh_dc, sh_rest, means, centre, 0)[3, 1])


def test_higher_degrees_are_not_looked_at_and_missing_ones_are_refused() -> None:
    sh_dc, sh_rest, means, centre = inputs(n=3)
    sh_rest[:, 3:] = np.nan
    assert np.isfinite(sh_colours(sh_dc, sh_rest, means, centre, 1)).all()
    with pytest.raises(OptionError, match="needs 15 coefficients, sh_rest has 8"):
        sh_colours(sh_dc, sh_rest[:, :8], means, centre, 3)
    with pytest.raises(OptionError, match="degree 4"):
        sh_colours(sh_dc, sh_rest, means, centre, 4)


def test_no_gaussians() -> None:
    sh_dc, sh_rest, means, centre = inputs(n=0)
    assert sh_colours(sh_dc, sh_rest, means, centre, 3, Pool(2)).shape == (0, 3)
