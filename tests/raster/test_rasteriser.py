"""The rasteriser against a sequential float64 compositor, and against itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_oracle import NAMES, draw, parameters
from raster_scenes import camera, scene

from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool
from sacha_core.raster.bounds import image_bounds
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats
from sacha_core.stopwatch import Stopwatch

PIXEL = 2e-5  # float32 rounding of some tens of blended terms, and 1e-6 relative of the exponential
BAND = 2e-5  # relative distance from a threshold within which float32 may decide otherwise
FLIP = 1.2 / 255  # what one decision at alpha = 1/255 may change in a colour of at most 1
GRADIENT = 2e-4  # relative to the largest gradient of its kind: float32 sums over a few thousand pixels
CLOSED = 2e-4  # transmittance of a pixel that has closed, or all but
COLOURS_AND_CAMERAS = [(1, 8, 8), (2, 16, 33), (3, 45, 70), (4, 57, 31), (4, 5, 3), (3, 1, 1)]


SHARED = Rasteriser(2)


@pytest.fixture(scope="module")
def rasteriser() -> Rasteriser:
    return Rasteriser(threads=2)


def close_outside_band(frame: Frame, splats: Splats, background: np.ndarray) -> float:
    """Compare with the oracle; give the part of the pixels that lie in the band."""
    oracle = draw(parameters(splats), frame.camera, background, frame.bins.projection.depths[: len(splats)])
    error = np.abs(frame.image - oracle.image.numpy()).max(axis=0)
    error = np.maximum(error, np.abs(frame.transmittance - oracle.transmittance.numpy()))
    inside = oracle.band < BAND
    assert error[~inside].max(initial=0) < PIXEL
    assert error[inside].max(initial=0) < FLIP
    return float(inside.mean())


@pytest.mark.parametrize(("channels", "width", "height"), COLOURS_AND_CAMERAS)
def test_image_is_that_of_the_sequential_compositor(
    rasteriser: Rasteriser, channels: int, width: int, height: int
) -> None:
    splats = scene(channels, 150, channels)
    background = np.linspace(0.2, 1, channels)
    frame = rasteriser.forward(splats, camera(width, height, 1.4 * max(width, height)), background)
    assert close_outside_band(frame, splats, background) < 0.02


@pytest.mark.parametrize("size", [0.0005, 0.01, 0.2])
def test_small_and_large_splats(rasteriser: Rasteriser, size: float) -> None:
    splats = scene(7, 120, 3, size)
    background = np.array([1.0, 0.5, 0.0])
    frame = rasteriser.forward(splats, camera(90, 66), background)
    assert close_outside_band(frame, splats, background) < 0.05


def compared_gradients(rasteriser: Rasteriser, splats: Splats, view, background: np.ndarray, with_transmittance: bool):
    frame = rasteriser.forward(splats, view, background)
    leaves = parameters(splats, gradients=True)
    oracle = draw(leaves, view, background, frame.bins.projection.depths[: len(splats)])
    rng = np.random.default_rng(5)
    calm = oracle.band > BAND  # a pixel that may flip has no gradient worth comparing
    upstream = rng.normal(size=frame.image.shape).astype(np.float32) * calm
    upstream_t = rng.normal(size=frame.transmittance.shape).astype(np.float32) * calm if with_transmittance else None
    loss = (oracle.image * torch.tensor(upstream)).sum()
    if upstream_t is not None:
        loss = loss + (oracle.transmittance * torch.tensor(upstream_t)).sum()
    loss.backward()
    gradients = rasteriser.backward(frame, upstream, upstream_t)
    return gradients, {name: leaves[name].grad.numpy() for name in NAMES}


@pytest.mark.parametrize(("channels", "with_transmittance"), [(1, False), (2, True), (3, False), (4, True)])
def test_gradients_are_those_of_automatic_differentiation(
    rasteriser: Rasteriser, channels: int, with_transmittance: bool
) -> None:
    splats = scene(20 + channels, 60, channels, 0.04)
    background = np.linspace(1, 0.3, channels)
    gradients, expected = compared_gradients(rasteriser, splats, camera(), background, with_transmittance)
    for name in NAMES:
        error = np.abs(getattr(gradients, name) - expected[name]).max() / np.abs(expected[name]).max()
        assert error < GRADIENT, f"{name}: {error}"


def test_gradients_are_finite_differences_of_the_oracle(rasteriser: Rasteriser) -> None:
    """Automatic differentiation of the oracle could be wrong in the way the kernel is: move parameters and look."""
    splats, view, background = scene(31, 12, 2, 0.06), camera(20, 18, 25.0), np.array([1.0, 0.2])
    frame = rasteriser.forward(splats, view, background)
    depths = frame.bins.projection.depths[:12].copy()
    upstream = np.random.default_rng(2).normal(size=frame.image.shape).astype(np.float32)
    calm = draw(parameters(splats), view, background, depths).band > 1e-3
    upstream *= calm
    gradients = rasteriser.backward(frame, upstream)

    def loss(name: str, at: tuple[int, ...], step: float) -> float:
        leaves = parameters(splats)
        leaves[name][at] += step
        return float((draw(leaves, view, background, depths).image * torch.tensor(upstream)).sum())

    rng = np.random.default_rng(3)
    for name in NAMES:
        gradient = getattr(gradients, name)
        for _ in range(8):
            at = tuple(int(rng.integers(side)) for side in gradient.shape)
            numeric = (loss(name, at, 1e-6) - loss(name, at, -1e-6)) / 2e-6
            assert abs(gradient[at] - numeric) < GRADIENT * max(np.abs(gradient).max(), 1), (name, at)


def test_clamped_jacobian_of_splats_far_outside_the_image(rasteriser: Rasteriser) -> None:
    view = camera(40, 30, 30.0)
    splats = scene(41, 80, 3, 0.3, spread=0.5)
    gradients, expected = compared_gradients(rasteriser, splats, view, np.ones(3), with_transmittance=False)
    in_camera = splats.means @ view.rotation.T + view.translation
    x = in_camera[:, 0] / in_camera[:, 2]
    limit = (view.width - view.cx + 0.15 * view.width) / view.fx
    assert ((x > limit) & (np.abs(gradients.scales).max(axis=1) > 0)).any()  # clamped ones take part
    for name in NAMES:
        error = np.abs(getattr(gradients, name) - expected[name]).max() / np.abs(expected[name]).max()
        assert error < GRADIENT, f"{name}: {error}"


def test_threads_do_not_change_a_bit() -> None:
    splats, view, background = scene(51, 3000, 4, 0.01), camera(150, 130, 160.0), np.array([1, 1, 1, 0.0])
    upstream = np.random.default_rng(1).normal(size=(4, 130, 150)).astype(np.float32)
    results = []
    for threads in (1, 2, 4, 5):
        own = Rasteriser(threads)
        frame = own.forward(splats, view, background)
        gradients = own.backward(frame, upstream)
        weights = own.colour_weights(frame, upstream[:1])
        drawn = [frame.image.copy(), frame.transmittance.copy(), frame.visible, weights, *vars(gradients).values()]
        results.append([*drawn, own.cover(splats, view)])
    for other in results[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_a_pool_may_be_shared_and_a_stopwatch_is_told_the_stages() -> None:
    splats, view, pool, watch = scene(56, 40), camera(), Pool(2), Stopwatch()
    own = Rasteriser(pool=pool, stopwatch=watch)
    frame = own.forward(splats, view, np.ones(3))
    image = frame.image.copy()
    own.backward(frame, np.ones_like(image))
    assert own.threads == 2
    assert {"project", "sort", "deal", "blend", "blend backward", "project backward"} <= watch.seconds.keys()
    assert min(watch.seconds.values()) > 0
    assert np.array_equal(image, Rasteriser(1).forward(splats, view, np.ones(3)).image)
    with pytest.raises(OptionError, match="3 threads"):
        Rasteriser(3, pool=pool)


def bounds(splats: Splats, view: Camera, margin: int = 0) -> tuple[int, int, int, int]:
    box = image_bounds(splats.means, splats.scales, splats.opacities, view, margin=margin)
    assert box is not None
    return box


def test_a_crop_is_that_part_of_the_image_to_the_bit(rasteriser: Rasteriser) -> None:
    splats, view, background = scene(52, 500, 3, 0.01, 0.08), camera(120, 150, 150.0), np.ones(3)
    whole = rasteriser.forward(splats, view, background).image.copy()
    left, top, width, height = bounds(splats, view)
    touched = (whole != 1).any(axis=0)
    rows, columns = np.flatnonzero(touched.any(axis=1)), np.flatnonzero(touched.any(axis=0))
    assert left <= columns[0]
    assert columns[-1] < left + width <= 120
    assert top <= rows[0]
    assert rows[-1] < top + height <= 150
    part = rasteriser.forward(splats, view.crop(left, top, width, height), background)
    assert np.array_equal(part.image, whole[:, top : top + height, left : left + width])
    part = rasteriser.forward(splats, view.crop(left + 5, top + 3, 33, 41), background)
    assert np.array_equal(part.image, whole[:, top + 3 : top + 44, left + 5 : left + 38])


@settings(max_examples=25)
@given(st.integers(0, 100), st.integers(0, 120), st.integers(1, 70), st.integers(1, 70))
def test_any_crop_is_that_part_of_the_image_to_the_bit(left: int, top: int, width: int, height: int) -> None:
    splats, view = scene(54, 200, 3, 0.015, 0.1), camera(120, 150, 150.0)
    whole = SHARED.forward(splats, view, np.ones(3))
    image, transmittance = whole.image.copy(), whole.transmittance.copy()
    part = SHARED.forward(splats, view.crop(left, top, width, height), np.ones(3))
    rows, columns = min(height, 150 - top), min(width, 120 - left)  # a crop may reach beyond the image
    assert np.array_equal(part.image[:, :rows, :columns], image[:, top : top + rows, left : left + columns])
    assert np.array_equal(part.transmittance[:rows, :columns], transmittance[top : top + rows, left : left + columns])


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_channels_do_not_change_one_another_nor_the_geometry(channels: int) -> None:
    splats, view = scene(55, 400, 4, 0.02), camera(70, 90, 90.0)
    fewer = replace(splats, colours=splats.colours[:, :channels])
    upstream = np.random.default_rng(1).normal(size=(4, 90, 70)).astype(np.float32)
    upstream[channels:] = 0
    whole = SHARED.forward(splats, view, np.ones(4))
    image, transmittance = whole.image.copy(), whole.transmittance.copy()
    gradients = {name: array.copy() for name, array in vars(SHARED.backward(whole, upstream)).items()}
    part = SHARED.forward(fewer, view, np.ones(channels))
    assert np.array_equal(part.image, image[:channels])
    assert np.array_equal(part.transmittance, transmittance)
    for name, array in vars(SHARED.backward(part, upstream[:channels])).items():
        assert np.array_equal(array, gradients[name][:, :channels] if name == "colours" else gradients[name]), name


@pytest.mark.parametrize("n", [1, 63, 64, 65, 128, 129])
def test_tiles_whose_entries_just_fill_batches_or_do_not(rasteriser: Rasteriser, n: int) -> None:
    """Faint splats over the whole of a small image: every tile holds all n, and none is hidden."""
    splats, view, background = scene(57, n, 2, 0.4, spread=0.02), camera(20, 40, 60.0), np.array([1.0, 0.3])
    splats.scales[:], splats.opacities[:] = (0.4, 0.5, 0.6), np.linspace(0.02, 0.05, n)
    gradients, expected = compared_gradients(rasteriser, splats, view, background, with_transmittance=True)
    frame = rasteriser.forward(splats, view, background)
    assert (np.diff(frame.bins.start) == n).all()
    assert close_outside_band(frame, splats, background) < 0.05
    for name in NAMES:
        error = np.abs(getattr(gradients, name) - expected[name]).max() / np.abs(expected[name]).max()
        assert error < GRADIENT, f"{name}: {error}"


def test_gradients_of_a_crop_are_those_of_the_whole_where_the_rest_is_constant(rasteriser: Rasteriser) -> None:
    splats, view, background = scene(53, 300, 3, 0.01, 0.05), camera(120, 150, 150.0), np.ones(3)
    left, top, width, height = bounds(splats, view, margin=2)
    upstream = np.random.default_rng(1).normal(size=(3, 150, 120)).astype(np.float32)
    frame = rasteriser.forward(splats, view, background)
    whole = {name: array.copy() for name, array in vars(rasteriser.backward(frame, upstream)).items()}
    frame = rasteriser.forward(splats, view.crop(left, top, width, height), background)
    part = rasteriser.backward(frame, upstream[:, top : top + height, left : left + width])
    for name, array in whole.items():  # tiles lie otherwise, so sums are taken in another order
        assert np.abs(getattr(part, name) - array).max() < GRADIENT * np.abs(array).max()


def test_colour_weights_are_the_blending_weights(rasteriser: Rasteriser) -> None:
    splats, view = scene(61, 50, 1, 0.05), camera(32, 32, 40.0)
    frame = rasteriser.forward(splats, view, np.zeros(1))
    oracle = draw(parameters(splats), view, np.zeros(1), frame.bins.projection.depths[:50])
    pixel_weights = np.random.default_rng(1).uniform(0, 1, (6, 32, 32)).astype(np.float32)
    pixel_weights[0] = 1
    weights = rasteriser.colour_weights(frame, pixel_weights)
    expected = np.einsum("nhw,mhw->nm", oracle.weights.numpy(), pixel_weights.astype(np.float64))
    flips = FLIP * (oracle.band < BAND).sum()
    assert np.abs(weights - expected).max() < GRADIENT * expected.max() + flips
    assert weights[:, 0].sum() == pytest.approx(float((1 - frame.transmittance.astype(np.float64)).sum()), rel=GRADIENT)
    by_colour = rasteriser.backward(frame, pixel_weights[2:3]).colours[:, 0]
    assert np.abs(weights[:, 2] - by_colour).max() < GRADIENT * by_colour.max()


@pytest.mark.parametrize(("n", "scale"), [(0, 0.05), (40, 0.02), (3000, 0.05)])
def test_cover_is_the_weight_of_all_pixels_alike(rasteriser: Rasteriser, n: int, scale: float) -> None:
    """Oracle: the importance pass, to the bit; tiles that reach beyond the image, pixels that close."""
    splats, view = scene(63, n, 3, scale), camera(150, 130, 160.0)
    frame = rasteriser.forward(splats, view, np.zeros(3))
    assert (frame.transmittance < CLOSED).any() == (n > 1000)
    expected = rasteriser.colour_weights(frame, np.ones((1, 130, 150), np.float32))[:, 0].copy()
    assert np.array_equal(rasteriser.cover(splats, view), expected)


def test_white_on_white_is_white(rasteriser: Rasteriser) -> None:
    """Blending weights and transmittance add up to one: a theorem, in every pixel."""
    splats = scene(62, 400, 3, 0.05)
    splats = Splats(splats.means, splats.scales, splats.quaternions, splats.opacities, np.ones((400, 3), np.float32))
    frame = rasteriser.forward(splats, camera(), np.ones(3))
    assert np.abs(frame.image - 1).max() < PIXEL


def test_equal_depths_keep_their_order(rasteriser: Rasteriser) -> None:
    """Two splats in the same place: the first is in front."""
    one, zero = np.ones((2, 3), np.float32), np.zeros((2, 3), np.float32)
    colours = np.array([[1.0, 0, 0], [0, 1, 0]], np.float32)
    splats = Splats(
        zero, 0.1 * one, np.array([[1, 0, 0, 0]] * 2, np.float32), np.array([0.9, 0.9], np.float32), colours
    )
    front, back, _ = rasteriser.forward(splats, camera(), np.zeros(3)).image
    assert front.max() == pytest.approx(0.9, abs=0.01)
    assert np.abs(back - front * (1 - front)).max() < PIXEL


def test_stops_when_nothing_behind_can_be_seen(rasteriser: Rasteriser) -> None:
    n = 300
    means = np.zeros((n, 3), np.float32)
    means[:, 2] = np.linspace(0.1, -0.1, n)
    splats = Splats(
        means,
        np.tile(np.array([1, 0.8, 0.6], np.float32), (n, 1)),
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.full(n, 0.9, np.float32),
        np.random.default_rng(0).random((n, 3), np.float32),
    )
    view = camera(64, 64, 60.0)
    frame = rasteriser.forward(splats, view, np.ones(3))
    assert (frame.bins.done < frame.bins.start[1:]).all()
    assert close_outside_band(frame, splats, np.ones(3)) < 0.01
    gradients, expected = compared_gradients(rasteriser, splats, view, np.ones(3), with_transmittance=True)
    for name in NAMES:
        assert np.abs(getattr(gradients, name) - expected[name]).max() < GRADIENT * np.abs(expected[name]).max()
