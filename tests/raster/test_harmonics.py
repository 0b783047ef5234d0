"""Spherical harmonics against SciPy, and their gradients against finite differences of that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import sph_harm_y

from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool
from sacha_core.raster.harmonics import ALL_DEGREES, degrees_in_use, sh_colours, sh_colours_backward, sh_rest_gradient
from sacha_core.raster.kernels.harmonics import BASIS, coefficient_gradients, harmonic_colours, harmonic_gradients

SINGLE = 2e-6  # float32, sums of sixteen terms of order one
SLOPE = 1e-5  # of the largest gradient: the same through products of three, and over distances down to a tenth
STEP = 1e-5  # of central differences in float64, good to 1e-9
DEGREES = [0, 1, 2, 3]
COUNTS = [0, 1, 15, 16, 17, 50]


def inputs(n: int = 50, coefficients: int = 15, seed: int = 0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    shapes = ((n, 3), (n, coefficients, 3), (n, 3), (3,))
    return tuple(rng.normal(size=shape).astype(np.float32) for shape in shapes)


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


def basis(means: np.ndarray, centre: np.ndarray, degree: int) -> np.ndarray:
    offsets = means.astype(float) - centre
    return real_harmonics(offsets / np.linalg.norm(offsets, axis=1, keepdims=True))[:, : (degree + 1) ** 2]


def exact(sh_dc: np.ndarray, sh_rest: np.ndarray, means: np.ndarray, centre: np.ndarray, degree: int) -> np.ndarray:
    """Give the colours in float64."""
    values = basis(means, centre, degree)
    coefficients = np.concatenate([sh_dc[:, None], sh_rest], 1).astype(float)[:, : values.shape[1]]
    return np.maximum(np.einsum("nk,nkc->nc", values, coefficients) + 0.5, 0)


@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("more", [0, 1])
def test_colours_are_those_of_scipy(degree: int, n: int, more: int) -> None:
    """With as many coefficients as the degree needs, or as the highest does."""
    arrays = inputs(n, 15 if more else (degree + 1) ** 2 - 1)
    found, expected = sh_colours(*arrays, degree), exact(*arrays, degree)
    assert found.dtype == np.float32
    assert found.shape == (n, 3)
    assert np.abs(found - expected).max(initial=0) < SINGLE * max(expected.max(initial=0), 1)
    assert n < 50 or (expected == 0).any()  # the cut is on trial too


@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("width", [3, 4])
def test_gradients_are_finite_differences(degree: int, n: int, width: int) -> None:
    sh_dc, sh_rest, means, centre = inputs(n, seed=3)
    rng = np.random.default_rng(1)
    upstream, before = (rng.normal(size=shape).astype(np.float32) for shape in ((n, width), (n, 3)))
    colours = np.full((n, width), np.nan, np.float32)
    sh_colours(sh_dc, sh_rest, means, centre, degree, out=colours)
    g_means = before.copy()
    cut = sh_colours_backward(sh_rest, means, centre, degree, colours, upstream, g_means)
    assert np.array_equal(cut, np.where(colours[:, :3] > 0, upstream[:, :3], 0))
    slope = np.zeros((n, 3))
    for axis in range(3):
        ends = []
        for step in (STEP, -STEP):
            moved = means.astype(float)
            moved[:, axis] += step
            ends.append((exact(sh_dc, sh_rest, moved, centre, degree) * upstream[:, :3]).sum(axis=1))
        slope[:, axis] = (ends[0] - ends[1]) / (2 * STEP)
    largest = max(np.abs(slope).max(initial=0), 1)
    assert np.abs(g_means - before - slope).max(initial=0) < SLOPE * largest
    values = basis(means, centre, degree)
    g_rest = np.zeros((n, 15, 3))
    g_rest[:, : values.shape[1] - 1] = values[:, 1:, None] * cut[:, None]
    assert np.abs(sh_rest_gradient(means, centre, degree, cut, 15) - g_rest).max(initial=0) < 2 * SINGLE
    assert BASIS[0] == pytest.approx(
        values[0, 0] if n else BASIS[0], rel=1e-12
    )  # by which `cut` is the gradient by sh_dc


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 70), st.integers(0, 70), st.integers(0, 3), st.integers(0, 99))
def test_any_range_gives_the_same_bits_and_nothing_outside(start: int, stop: int, degree: int, seed: int) -> None:
    n, none = 70, np.float32(7)
    sh_dc, sh_rest, means, centre = inputs(n, seed=seed)
    rows, others = np.arange(start, stop), np.setdiff1d(np.arange(n), np.arange(start, stop))
    gradient = np.random.default_rng(seed).normal(size=(n, 4)).astype(np.float32)
    gradient[np.random.default_rng(seed).random(n) < 0.5] = 0
    results = []
    for first, last in ((0, n), (start, stop)):
        colours, cut, g_means, g_rest = (np.full(shape, none) for shape in ((n, 4), (n, 3), (n, 3), (n, 15, 3)))
        tilts = np.full((3, n, 3), none)
        harmonic_colours(first, last, sh_dc, sh_rest, means, centre, degree, ALL_DEGREES, colours, tilts)
        harmonic_gradients(first, last, tilts, colours, gradient, cut, g_means)
        coefficient_gradients(first, last, means, centre, degree, cut, g_rest)
        results.append((colours, cut, g_means, g_rest, tilts.swapaxes(0, 1)))
    for whole, part in zip(*results, strict=True):
        assert np.array_equal(part[rows], whole[rows])
        assert (part[others] == none).all()
    assert (results[0][0][:, 3] == none).all()


def test_threads_change_no_bit() -> None:
    arrays = inputs(n=301)
    alone, shared = sh_colours(*arrays, 3), sh_colours(*arrays, 3, Pool(3))
    assert np.array_equal(alone, shared)
    upstream, found = np.ones((301, 3), np.float32), []
    for pool in (None, Pool(3)):
        g_means = np.zeros((301, 3), np.float32)
        cut = sh_colours_backward(*arrays[1:], 3, alone, upstream, g_means, pool)
        found.append((cut, g_means))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


def test_degrees_of_single_gaussians_give_the_bits_of_zeros_spelled_out() -> None:
    sh_dc, sh_rest, means, centre = inputs(200)
    degrees = np.random.default_rng(0).integers(0, 4, 200).astype(np.uint8)
    degrees[32:64] = 0
    for row, degree in zip(sh_rest, degrees, strict=True):
        row[(degree + 1) ** 2 - 1 :] = 0
    assert np.array_equal(degrees_in_use(sh_rest), degrees)
    spelled_out = sh_colours(sh_dc, sh_rest, means, centre, 3)
    for degree in DEGREES:
        rows = degrees == degree
        assert np.array_equal(sh_colours(sh_dc[rows], sh_rest[rows], means[rows], centre, degree), spelled_out[rows])
    for row, degree in zip(sh_rest, degrees, strict=True):
        row[(degree + 1) ** 2 - 1 :] = np.nan  # not looked at
    assert np.array_equal(sh_colours(sh_dc, sh_rest, means, centre, 3, degrees=degrees), spelled_out)
    assert np.array_equal(
        sh_colours(sh_dc, sh_rest, means, centre, 3, Pool(2), np.zeros_like(degrees)),
        sh_colours(sh_dc, sh_rest, means, centre, 0),
    )


@pytest.mark.parametrize("coefficients", [0, 3, 8, 15])
def test_degrees_in_use_of_fewer_coefficients(coefficients: int) -> None:
    _, sh_rest, _, _ = inputs(5, coefficients)
    highest = {0: 0, 3: 1, 8: 2, 15: 3}[coefficients]
    assert degrees_in_use(sh_rest).tolist() == [highest] * 5
    assert degrees_in_use(0 * sh_rest).tolist() == [0] * 5


def test_direction_that_does_not_exist_stays_finite_and_a_broken_coefficient_does_not_hide() -> None:
    sh_dc, sh_rest, means, centre = inputs(n=4)
    means[0], means[1], means[2, 1] = centre, np.nan, np.inf
    colours, upstream, g_means = (
        sh_colours(sh_dc, sh_rest, means, centre, 3),
        np.ones((4, 3), np.float32),
        np.zeros((4, 3), np.float32),
    )
    assert np.isfinite(colours).all()
    cut = sh_colours_backward(sh_rest, means, centre, 3, colours, upstream, g_means)
    assert np.isfinite(g_means).all()
    assert not g_means[:3].any()
    assert np.isfinite(sh_rest_gradient(means, centre, 3, cut, 15)).all()
    sh_dc[3, 1] = np.nan
    assert np.isnan(sh_colours(sh_dc, sh_rest, means, centre, 0)[3, 1])


def test_broken_gradient_does_not_hide_and_what_has_none_is_not_looked_at() -> None:
    _, sh_rest, means, centre = inputs(n=40)
    colours, upstream, g_means = (np.ones((40, 3), np.float32) for _ in range(3))
    upstream[5:30], upstream[7, 2], sh_rest[9:20] = 0, np.nan, np.nan
    cut = sh_colours_backward(sh_rest, means, centre, 3, colours, upstream, g_means)
    assert np.isnan(cut[7, 2])
    assert np.isnan(g_means[7]).all()
    unseen = np.delete(np.arange(5, 30), 2)
    assert (g_means[unseen] == 1).all()
    assert (g_means[:5] != 1).all()


def test_higher_degrees_are_not_looked_at_and_missing_ones_are_refused() -> None:
    sh_dc, sh_rest, means, centre = inputs(n=3)
    sh_rest[:, 3:] = np.nan
    assert np.isfinite(sh_colours(sh_dc, sh_rest, means, centre, 1)).all()
    with pytest.raises(OptionError, match="needs 15 coefficients, sh_rest has 8"):
        sh_colours(sh_dc, sh_rest[:, :8], means, centre, 3)
    with pytest.raises(OptionError, match="degree 4"):
        sh_colours(sh_dc, sh_rest, means, centre, 4)
    with pytest.raises(OptionError, match=r"expected \(3,\)"):
        sh_colours(sh_dc, sh_rest, means, centre, 1, degrees=np.zeros(2, np.uint8))
    for wrong in (np.zeros((3, 5), np.float32), np.zeros((3, 3)), np.zeros((3, 8), np.float32)[:, ::2]):
        with pytest.raises(OptionError, match="colours go to"):
            sh_colours(sh_dc, sh_rest, means, centre, 1, out=wrong)
