"""The rectangle that Gaussians reach: nothing is drawn outside it, and it is no larger than balls need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_scenes import camera, scene

from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import image_bounds, pixel_box
from sacha_core.raster.camera import Camera
from sacha_core.raster.kernels.bounds import reach
from sacha_core.raster.rasteriser import NEAR, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.raster.view import view_parameters

PIXELS = 0.02  # what rounding and its allowance add to a side: 4e-3, and 1e-5 of a radius of a thousand pixels
Box = tuple[int, int, int, int]


@pytest.fixture(scope="module")
def rasteriser() -> Rasteriser:
    return Rasteriser(threads=1)


def box_of(splats: Splats, view: Camera, margin: int = 0, pool: Pool | None = None) -> Box | None:
    return image_bounds(splats.means, splats.scales, splats.opacities, view, margin=margin, pool=pool)


def drawn(rasteriser: Rasteriser, splats: Splats, view: Camera) -> np.ndarray:
    """Give which pixels any splat touches."""
    return rasteriser.forward(splats, view, np.ones(splats.channels)).transmittance < 1


def ball_sides(splats: Splats, view: Camera) -> np.ndarray:
    """Give left, top, right, bottom of each splat as a ball, float64: 3DGS's projection, alpha 1/255 at the rim, clamped slopes."""
    x, y, z = (splats.means.astype(float) @ view.rotation.T + view.translation).T
    left, right, top, bottom = view.edges
    slack_x, slack_y = 0.15 * (right - left), 0.15 * (bottom - top)
    limit = 2 * np.log(255 * splats.opacities.astype(float))
    square = splats.scales.astype(float).max(axis=1) ** 2
    slope_x, slope_y = (
        np.clip(x / z, left - slack_x, right + slack_x),
        np.clip(y / z, top - slack_y, bottom + slack_y),
    )
    radius_x = np.sqrt(limit * (square * (view.fx / z) ** 2 * (1 + slope_x**2) + 0.3))
    radius_y = np.sqrt(limit * (square * (view.fy / z) ** 2 * (1 + slope_y**2) + 0.3))
    u, v = view.fx * x / z + view.cx, view.fy * y / z + view.cy
    return np.stack([u - radius_x, v - radius_y, u + radius_x, v + radius_y], axis=1)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 40), st.floats(1e-4, 0.5), st.integers(1, 90), st.integers(1, 90))
def test_nothing_is_drawn_outside(
    rasteriser: Rasteriser, seed: int, n: int, size: float, width: int, height: int
) -> None:
    rng = np.random.default_rng(seed)
    splats = scene(seed, n)
    splats = replace(splats, scales=(size * rng.lognormal(0, 2, (n, 3))).astype(np.float32))  # needles among them
    view = camera(width, height).crop(*rng.integers(-20, 20, 2), width, height)
    touched, box = drawn(rasteriser, splats, view), box_of(splats, view)
    if box is None:
        assert not touched.any()
        return
    left, top, w, h = box
    assert 0 <= left < left + w <= width
    assert 0 <= top < top + h <= height
    touched[top : top + h, left : left + w] = False
    assert not touched.any()


def test_sides_are_those_of_balls() -> None:
    splats, view = scene(3, 61), camera(300, 200)
    splats.opacities[:] = np.random.default_rng(0).uniform(0.01, 1, 61)
    expected = ball_sides(splats, view)
    inside = (expected[:, :2] < (300, 200)).all(axis=1) & (expected[:, 2:] > 0).all(axis=1)
    assert inside.sum() > 10
    parameters = view_parameters(view, NEAR)
    for row in np.flatnonzero(inside):
        sides = np.array(reach(row, row + 1, splats.means, splats.scales, splats.opacities, parameters))
        assert (sides[:2] <= expected[row, :2]).all()
        assert (sides[2:] >= expected[row, 2:]).all()
        assert sides == pytest.approx(expected[row], abs=PIXELS)
    together = np.array(reach(0, 61, splats.means, splats.scales, splats.opacities, parameters))
    assert together[:2] == pytest.approx(expected[inside, :2].min(axis=0), abs=PIXELS)
    assert together[2:] == pytest.approx(expected[inside, 2:].max(axis=0), abs=PIXELS)


@pytest.mark.parametrize("name", ["means", "scales", "opacities"])
@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_hides_nothing(rasteriser: Rasteriser, name: str, poison: float) -> None:
    splats, view = scene(1, 40, 3, 0.01), camera()
    whole = box_of(splats, view)
    array = getattr(splats, name).copy()
    array[17] = poison
    poisoned = replace(splats, **{name: array})
    touched, box = drawn(rasteriser, poisoned, view), box_of(poisoned, view)
    assert box is not None
    assert whole is not None
    left, top, w, h = box
    assert touched.any()
    touched[top : top + h, left : left + w] = False
    assert not touched.any()
    if name != "scales":  # such a Gaussian is left out; of a scale it is enough that the box is large enough
        others = np.arange(40) != 17
        assert box == box_of(Splats(*(array[others] for array in vars(splats).values())), view)


@pytest.mark.parametrize("n", [1, 2, 15, 16, 17, 33])
def test_any_split_into_ranges_gives_the_same(n: int) -> None:
    splats, view = scene(4, n, 3, 0.01), camera(400, 300)
    parameters = view_parameters(view, NEAR)
    arrays = (splats.means, splats.scales, splats.opacities, parameters)
    whole = reach(0, n, *arrays)
    for cut in range(n + 1):
        parts = np.array([reach(0, cut, *arrays), reach(cut, n, *arrays)])
        assert (*parts[:, :2].min(axis=0), *parts[:, 2:].max(axis=0)) == whole
    assert box_of(splats, view) == box_of(splats, view, pool=Pool(3)) == pixel_box([whole], view)


def test_margin_ends_at_the_image_and_nothing_is_none() -> None:
    splats, view = scene(5, 1, 3, 0.002), camera(100, 120)
    plain = box_of(splats, view)
    assert plain is not None
    left, top, width, height = plain
    assert box_of(splats, view, margin=2) == (left - 2, top - 2, width + 4, height + 4)
    assert box_of(splats, view, margin=1000) == (0, 0, 100, 120)
    behind = replace(splats, means=splats.means + 10 * (view.centre - splats.means).astype(np.float32))
    for nothing in (behind, replace(splats, opacities=np.full(1, 1 / 256, np.float32)), scene(5, 0)):
        assert box_of(nothing, view, margin=5) is None


def test_between_pixel_centres_there_is_nothing() -> None:
    view = camera(10, 10)
    assert pixel_box([(2.6, 2.4, 3.4, 2.6)], view) is None
    assert pixel_box([(2.5, 2.4, 3.5, 2.6)], view) == (2, 2, 2, 1)
    assert pixel_box([], view) is None
