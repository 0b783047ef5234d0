"""The rasteriser against a sequential float64 compositor, and against itself."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from raster_oracle import NAMES, draw, parameters
from raster_scenes import camera, scene

from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats

PIXEL = 2e-5  # float32 rounding of some tens of blended terms, and 1e-6 relative of the exponential
BAND = 2e-5  # relative distance from a threshold within which float32 may decide otherwise
FLIP = 1.2 / 255  # what one decision at alpha = 1/255 may change in a colour of at most 1
GRADIENT = 2e-4  # relative to the largest gradient of its kind: float32 sums over a few thousand pixels
COLOURS_AND_CAMERAS = [(1, 8, 8), (2, 16, 33), (3, 45, 70), (4, 57, 31), (4, 5, 3), (3, 1, 1)]


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
