"""What removing a Gaussian changes, against drawing the picture again without it in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from raster_oracle import STOP, draw, parameters
from raster_scenes import camera, scene

from sacha_core.errors import OptionError
from sacha_core.raster.camera import Camera
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.removal import RemovalChanges
from sacha_core.raster.splats import Splats

BAND = 1e-4  # relative distance from a threshold within which float32 may decide otherwise
# relative to the largest: a change is made of what lies behind, which is the final colour less what was passed, some 3e-7 off after tens of
# roundings, and up to 100 times as much in the few pixels where nearly all light is held back
SUMS = 2e-5
LEFT_OUT = 0.01  # of the largest; such light is a hundredth of a pixel's at most
KINDS = ("squared", "absolute")
ALONE = 1e-5  # relative: float32 sums over a few tiles
UPRIGHT = np.array([1, 0, 0, 0], np.float32)


@pytest.fixture(scope="module")
def rasteriser() -> Rasteriser:
    return Rasteriser(threads=2)


def pixel_weights(view: Camera, m: int = 2) -> np.ndarray:
    """Give m images, the first of which is all ones."""
    weights = np.random.default_rng(0).uniform(0, 1, (m, view.height, view.width)).astype(np.float32)
    weights[0] = 1
    return weights


def compared(rasteriser: Rasteriser, splats: Splats, view: Camera, background, counted: int, which=None):
    """Give changes found and expected, (3, n, 2), of the Gaussians `which`, and the whole picture with the pixels that were compared."""
    which = list(range(len(splats)) if which is None else which)
    weights = pixel_weights(view)
    frame = rasteriser.forward(splats, view, background)
    depths = frame.bins.projection.depths[: len(splats)].copy()

    def drawn(without: int | None):
        opacities = (
            np.where(np.arange(len(splats)) == without, 0, splats.opacities)
            if without is not None
            else splats.opacities
        )
        return draw(parameters(replace(splats, opacities=opacities)), view, background, depths)

    whole, fewer = drawn(None), [drawn(i) for i in which]
    calm = np.min([picture.band for picture in (whole, *fewer)], axis=0) > BAND
    assert calm.mean() > 0.8
    weights *= calm
    before, expected = whole.image.numpy()[:counted], np.zeros((2, len(which), 2))
    for place, picture in enumerate(fewer):
        after = picture.image.numpy()[:counted]
        changes = (after - before) ** 2, abs(after - before)
        expected[:, place] = np.einsum("kchw,mhw->km", changes, weights)
    found = as_array(rasteriser.removal_changes(frame, weights, counted))
    return found[:, which], expected, whole, calm


def as_array(changes: RemovalChanges) -> np.ndarray:
    return np.stack([getattr(changes, kind) for kind in KINDS])


def agree(found: np.ndarray, expected: np.ndarray) -> None:
    for kind, name in enumerate(KINDS):
        assert np.abs(found[kind] - expected[kind]).max() < SUMS * np.abs(expected[kind]).max(), name


def layers(opacities: list[float], colours: list[float], view: Camera) -> Splats:
    """Give Gaussians much wider than the image, one behind the other, each of one grey."""
    n = len(opacities)
    means = np.linspace(0.1, -0.1, n)[:, None] * (view.rotation[2] * -1)
    return Splats(
        means.astype(np.float32), np.full((n, 3), 2, np.float32), np.tile(UPRIGHT, (n, 1)), np.array(opacities, np.float32),
        np.repeat(np.array(colours, np.float32)[:, None], 3, axis=1),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("channels", "counted", "width", "height"),
    [(1, 1, 32, 32), (3, 3, 45, 37), (4, 3, 32, 32), (4, 4, 7, 33)],
)
def test_changes_are_those_of_drawing_without(rasteriser, channels, counted, width, height) -> None:
    splats, background = scene(channels, 50, channels, 0.05), np.linspace(0.2, 1, channels)
    splats.opacities[:] *= 0.6
    view = camera(width, height, 1.2 * max(width, height))
    found, expected, whole, _ = compared(rasteriser, splats, view, background, counted)
    assert float(whole.transmittance.min()) > 1e-2 / 2  # nothing closes
    agree(found, expected)


@pytest.mark.parametrize("n", [64, 65, 129])
def test_changes_of_many_in_every_tile(rasteriser, n) -> None:
    """Batches that are just full and just not."""
    view = camera(20, 40, 60.0)
    rng = np.random.default_rng(n)
    splats = layers([0.0] * n, [0.0] * n, view)
    splats.opacities[:], splats.colours[:] = rng.uniform(0.02, 0.05, n), rng.uniform(0, 1, (n, 3))
    found, expected, _, _ = compared(rasteriser, splats, view, np.ones(3), 3, [0, 1, n // 2, n - 2, n - 1])
    agree(found, expected)


@pytest.mark.parametrize("opacities", [[1.0], [0.5, 1.0, 0.7], [0.95, 0.9, 0.99], [1.0, 0.9, 0.95]])
def test_opaque_layers_reveal_what_lies_behind_them(rasteriser, opacities) -> None:
    """Alphas at their cap, and pixels that the last layer closes: without another, it is drawn."""
    view = camera(16, 16, 60.0)
    splats = layers(opacities, [0.1, 0.8, 0.4][: len(opacities)], view)
    found, expected, whole, _ = compared(rasteriser, splats, view, np.ones(3), 3)
    closed = (1 - np.minimum(opacities, 0.99)).prod() < STOP
    assert (whole.weights[-1].numpy().max() == 0) == closed
    agree(found, expected)


def test_what_closed_pixels_leave_out_is_bounded(rasteriser) -> None:
    """Colours within 0 and 1: a change is off by the light that goes to the background instead of to what was not drawn."""
    splats, view = scene(5, 60, 3, 0.2), camera(32, 32, 40.0)
    splats.opacities[:] = np.random.default_rng(3).uniform(0.5, 1, 60)
    found, expected, whole, calm = compared(rasteriser, splats, view, np.ones(3), 3)
    transmittance, weights = whole.transmittance.numpy(), whole.weights.numpy()
    closed = transmittance < 1e-2
    assert closed.mean() > 0.5
    order = np.argsort((splats.means @ view.rotation.T + view.translation)[:, 2], kind="stable")
    before = np.empty_like(weights)
    before[order] = 1 - np.cumsum(weights[order], axis=0) + weights[order]
    alpha = weights / before
    light = np.where(weights > 0, STOP / (1 - alpha), transmittance) * closed * calm
    bound = 3 * light.sum(axis=(1, 2))  # over channels
    error = np.abs(found[:, :, 0] - expected[:, :, 0])
    rounding = SUMS * np.abs(expected).max()
    assert (error[1] <= bound + rounding).all()  # |d|
    assert (error[0] <= 3 * bound + rounding).all()  # d^2, where d is within -1 and 1 and the light below 1
    assert (error.max(axis=1) < LEFT_OUT * np.abs(expected[:, :, 0]).max(axis=1)).all()


def test_unseen_gaussians_change_nothing(rasteriser) -> None:
    """Too faint, behind the camera, beside the image, hidden: exactly nothing."""
    view = camera(32, 32, 40.0)
    splats = layers([0.9, 0.9, 0.9, 0.9, 0.9, 0.003, 0.9, 0.9, 0.9], np.linspace(0, 1, 9).tolist(), view)
    splats.means[6] = view.centre + 0.5 * view.rotation[2] * -1
    splats.means[7] = view.centre + view.rotation[2] + 30 * view.rotation[0]
    splats.scales[7] = 0.01
    frame = rasteriser.forward(splats, view, np.ones(3))
    changes = as_array(rasteriser.removal_changes(frame, pixel_weights(view)))
    assert not changes[:, 5:].any()
    assert (changes[:, :3] > 0).all()


@pytest.mark.parametrize("n", [0, 1])
def test_no_gaussian_and_one(rasteriser, n) -> None:
    """One alone uncovers the background: in closed form, its own squares weighted by its weights."""
    view, background = camera(20, 20, 30.0), np.array([0.5, 1.0, 0.0])
    splats = scene(3, 1, 3, 0.1)
    splats = Splats(*(getattr(splats, name)[:n] for name in ("means", "scales", "quaternions", "opacities", "colours")))
    frame = rasteriser.forward(splats, view, background)
    changes = rasteriser.removal_changes(frame, np.ones((1, 20, 20)))
    assert changes.squared.shape == (n, 1)
    difference = frame.image.astype(np.float64) - background[:, None, None]
    assert changes.squared.sum() == pytest.approx((difference**2).sum(), rel=ALONE)
    assert changes.absolute.sum() == pytest.approx(np.abs(difference).sum(), rel=ALONE)
    assert (n == 0) == (changes.squared.sum() == 0)


def test_what_has_the_colour_of_all_behind_it_is_not_missed(rasteriser) -> None:
    """White before white: weights, and nothing that would change."""
    splats, view = scene(8, 400, 3, 0.03), camera()
    splats.colours[:] = 1
    frame = rasteriser.forward(splats, view, np.ones(3))
    weights = rasteriser.colour_weights(frame, pixel_weights(view))[:, 0]
    changes = rasteriser.removal_changes(frame, pixel_weights(view))
    assert (changes.absolute[:, 0] <= SUMS * weights.max()).all()


def test_each_image_of_weights_is_by_itself(rasteriser) -> None:
    splats, view = scene(9, 300, 3, 0.03), camera()
    frame = rasteriser.forward(splats, view, np.ones(3))
    weights = pixel_weights(view, m=5)
    together = as_array(rasteriser.removal_changes(frame, weights))
    alone = [as_array(rasteriser.removal_changes(frame, weights[k : k + 1])) for k in range(5)]
    assert np.array_equal(together, np.concatenate(alone, axis=2))


def test_threads_do_not_change_a_bit_of_what_removing_changes() -> None:
    splats, view = scene(51, 3000, 4, 0.01), camera(150, 130, 160.0)
    results = []
    for threads in (1, 2, 5):
        own = Rasteriser(threads)
        results.append(as_array(own.removal_changes(own.forward(splats, view, np.ones(4)), pixel_weights(view), 3)))
    assert all(np.array_equal(results[0], other) for other in results[1:])


def test_refuses_what_does_not_fit(rasteriser) -> None:
    splats, view = scene(1, 5), camera(8, 8)
    stale = rasteriser.forward(splats, view, np.ones(3))
    frame = rasteriser.forward(splats, view, np.ones(3))
    weights = pixel_weights(view)
    with pytest.raises(OptionError, match="stale"):
        rasteriser.removal_changes(stale, weights)
    for channels in (0, 4):
        with pytest.raises(OptionError, match=f"{channels} channels were asked for, expected 1 to 3"):
            rasteriser.removal_changes(frame, weights, channels)
    with pytest.raises(OptionError, match="shape"):
        rasteriser.removal_changes(frame, weights[:, 1:])


def test_largest_weights_are_those_of_the_definition(rasteriser: Rasteriser) -> None:
    """Oracle: the float64 compositor's weights, pixel by pixel."""
    splats, view = scene(7, 60), camera()
    background = np.zeros(3, np.float32)
    frame = rasteriser.forward(splats, view, background)
    found = rasteriser.largest_weights(frame)
    expected = draw(parameters(splats), view, background, frame.bins.projection.depths[:60].copy())
    calm = expected.band > BAND
    weights = expected.weights.numpy()
    np.testing.assert_allclose(found, weights.max(axis=(1, 2)), rtol=ALONE, atol=1e-6 if calm.all() else 1 / 255)
    assert (found > 0).sum() > 30
    rasteriser.forward(splats, view, background)
    with pytest.raises(OptionError, match="stale"):
        rasteriser.largest_weights(frame)
