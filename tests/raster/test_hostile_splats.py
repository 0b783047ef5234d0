"""What training and files can throw at the rasteriser: it draws what can be drawn, and stays finite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_oracle import draw, parameters
from raster_scenes import camera, scene

from sacha_core.errors import OptionError, SachaError
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import ColourError, Splats

PIXEL = 2e-5  # as in test_rasteriser
WHITE = np.ones(3)
POISON = [np.nan, np.inf, -np.inf]
THRESHOLDS = [
    0.0,
    1e-45,
    1e-38,
    1e-16,
    1 / 255,
    0.1,
    0.99,
    1.0,
    3.0,
    1e15,
    1e30,
    3e38,
]  # the kernels' own, and their neighbours


@pytest.fixture(scope="module")
def rasteriser() -> Rasteriser:
    return Rasteriser(threads=2)


def finite(rasteriser: Rasteriser, splats: Splats, width: int = 45, height: int = 70) -> np.ndarray:
    """Draw forward and backward; everything is finite. Gives the image."""
    frame = rasteriser.forward(splats, camera(width, height), WHITE)
    assert np.isfinite(frame.image).all()
    assert np.isfinite(frame.transmittance).all()
    image = frame.image.copy()
    gradients = rasteriser.backward(frame, np.ones_like(image))
    for name, array in vars(gradients).items():
        assert np.isfinite(array).all(), name
        assert not array[~frame.visible].any(), name
    return image


@pytest.mark.parametrize("name", ["means", "scales", "quaternions", "opacities"])
@pytest.mark.parametrize("poison", POISON)
def test_poisoned_splats_vanish(rasteriser: Rasteriser, name: str, poison: float) -> None:
    splats = scene(1, 37)
    bad = np.arange(37) % 5 == 0
    array = getattr(splats, name).copy()
    array[bad, ...] = poison
    image = finite(rasteriser, replace(splats, **{name: array}))
    kept = Splats(*(getattr(splats, field)[~bad] for field in vars(splats)))
    assert np.array_equal(image, finite(rasteriser, kept))


@pytest.mark.parametrize("poison", [*POISON, 1e30, -3.4e38])
@pytest.mark.parametrize("row", [0, 4, 8])
def test_poisoned_colours_are_refused_by_row(rasteriser: Rasteriser, poison: float, row: int) -> None:
    splats = scene(1, 9)
    splats.colours[row:, 1] = poison  # the first is named
    with pytest.raises(ColourError, match=f"colour of Gaussian {row} ") as caught:
        rasteriser.forward(splats, camera(), WHITE)
    assert caught.value.row == row


def test_largest_colour_still_has_finite_gradients(rasteriser: Rasteriser) -> None:
    splats = scene(1, 9)
    splats.colours[4, 1] = np.nextafter(np.float32(1e30), np.float32(0))
    finite(rasteriser, splats)


@pytest.mark.parametrize("opacity", [0.0, -1.0, 0.0039, 1.5, 1e6])
def test_opacities_outside_their_range(rasteriser: Rasteriser, opacity: float) -> None:
    splats = scene(2, 30)
    splats.opacities[:] = opacity
    image = finite(rasteriser, splats)
    assert (image == 1).all() == (opacity < 1 / 255)


def test_needles_and_flat_and_zero_sized_splats(rasteriser: Rasteriser) -> None:
    splats = scene(3, 64)
    splats.scales[:16] = (0.5, 1e-6, 1e-6)
    splats.scales[16:32] = (0.2, 0.2, 0)
    splats.scales[32:48] = 0
    image = finite(rasteriser, splats)
    frame = rasteriser.forward(splats, camera(), WHITE)
    oracle = draw(parameters(splats), camera(), WHITE, frame.bins.projection.depths[:64])
    calm = oracle.band > 1e-3  # a needle of a thousand pixels magnifies the rounding of its angle
    assert np.abs(image - oracle.image.numpy())[:, calm].max() < 50 * PIXEL


def test_zero_quaternions_vanish(rasteriser: Rasteriser) -> None:
    splats = scene(4, 20)
    splats.quaternions[:] = 0
    assert (finite(rasteriser, splats) == 1).all()


def test_behind_and_before_the_near_plane(rasteriser: Rasteriser) -> None:
    splats, view = scene(5, 40), camera()
    forward = view.rotation[2]
    splats.means[:] = view.centre + forward * np.linspace(-1, 0.0999, 40)[:, None]
    assert (finite(rasteriser, splats) == 1).all()
    splats.means[:] = view.centre + forward * 0.11
    assert (finite(rasteriser, splats) != 1).any()


@pytest.mark.parametrize("n", [0, 1, 15, 16, 17])
def test_any_number_of_splats_down_to_none(rasteriser: Rasteriser, n: int) -> None:
    image = finite(rasteriser, scene(6, n))
    assert image.shape == (3, 70, 45)
    if n == 0:
        assert (image == 1).all()


@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 31), (8, 32), (9, 33), (640, 2), (2, 640)])
def test_any_size_of_image(rasteriser: Rasteriser, width: int, height: int) -> None:
    assert finite(rasteriser, scene(7, 50), width, height).shape == (3, height, width)


def test_more_keys_than_there_was_room_for() -> None:
    """Every splat covers a large image: the room for keys is doubled until they fit, and the image is right."""
    splats, view = scene(8, 600, 3, 5.0), camera(400, 300, 300.0)
    fresh = Rasteriser(2)
    frame = fresh.forward(splats, view, WHITE)
    assert len(frame.bins.entries) > 600 * 400
    again = Rasteriser(1).forward(splats, view, WHITE)
    assert np.array_equal(frame.image, again.image)


def test_room_for_a_few_large_splats_is_not_taken_for_what_many_small_ones_need(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sacha_core.raster.binning.MAX_KEYS", 1 << 18)
    rasteriser, small = Rasteriser(threads=2), scene(5, 3000)
    rasteriser.forward(scene(2, 16, size=3.0), camera(2000, 2000), WHITE)
    frame = rasteriser.forward(small, camera(), WHITE)
    assert frame.bins.capacity <= 1 << 18
    expected = Rasteriser(threads=2).forward(small, camera(), WHITE)
    np.testing.assert_array_equal(frame.image, expected.image)


def test_a_scale_in_the_wrong_unit_is_told_and_leaves_the_rasteriser_usable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sacha_core.raster.binning.MAX_KEYS", 20000)
    fresh = Rasteriser(1)
    with pytest.raises(SachaError, match="more than 20000 tiles"):
        fresh.forward(scene(8, 600, 3, 5.0), camera(400, 300, 300.0), WHITE)
    assert finite(fresh, scene(8, 30)).any()


@settings(max_examples=30)
@given(st.lists(st.sampled_from(THRESHOLDS + [-x for x in THRESHOLDS] + POISON), min_size=11, max_size=33))
def test_values_at_the_thresholds(values: list[float]) -> None:
    columns = np.resize(np.array(values, np.float32), (9, 11))
    splats = Splats(columns[:, :3], columns[:, 3:6], columns[:, 6:10], columns[:, 10], np.ones((9, 3), np.float32))
    frame = SHARED.forward(splats, camera(20, 40), WHITE)
    assert np.isfinite(frame.image).all()
    gradients = SHARED.backward(frame, np.ones_like(frame.image))
    for name in ("colours", "means_2d", "opacities"):
        assert np.isfinite(getattr(gradients, name)).all()


SHARED = Rasteriser(1)


def test_shapes_that_disagree_are_refused(rasteriser: Rasteriser) -> None:
    splats = scene(9, 5)
    for name, wrong in (("means", np.zeros((5, 2))), ("scales", np.zeros((4, 3))), ("opacities", np.zeros((5, 1)))):
        with pytest.raises(OptionError, match=name):
            rasteriser.forward(replace(splats, **{name: wrong}), camera(), WHITE)
    with pytest.raises(OptionError, match=r"colours have shape \(5, 5\)"):
        rasteriser.forward(replace(splats, colours=np.zeros((5, 5))), camera(), WHITE)
    with pytest.raises(OptionError, match="background"):
        rasteriser.forward(splats, camera(), np.ones(4))
    with pytest.raises(OptionError, match="pixels"):
        rasteriser.forward(splats, replace(camera(), width=0), WHITE)
    with pytest.raises(OptionError, match="finite"):
        rasteriser.forward(splats, replace(camera(), fx=np.nan), WHITE)
    with pytest.raises(OptionError, match="threads"):
        Rasteriser(0)


def test_stale_frames_and_wrong_gradients_are_refused(rasteriser: Rasteriser) -> None:
    splats = scene(10, 5)
    old = rasteriser.forward(splats, camera(), WHITE)
    new = rasteriser.forward(splats, camera(), WHITE)
    with pytest.raises(OptionError, match="stale"):
        rasteriser.backward(old, np.zeros_like(old.image))
    with pytest.raises(OptionError, match="shape"):
        rasteriser.backward(new, np.zeros((4, 70, 45)))
    with pytest.raises(OptionError, match="shape"):
        rasteriser.colour_weights(new, np.zeros((1, 70, 44)))
