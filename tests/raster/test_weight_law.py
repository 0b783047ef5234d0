"""Blending weights and transmittance share out every pixel: sum_i w_ip = 1 - T_p, whatever is drawn, and what stopping early leaves out."""

from __future__ import annotations

import numpy as np
import pytest
import raster_oracle
from hypothesis import given, settings
from hypothesis import strategies as st
from raster_scenes import camera, scene

from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats

RASTERISER = Rasteriser(1)
SHARE = 2e-6  # of a pixel, a term: float32 rounding of what blending sums
LEFT = (
    1e-4 / (1 - 0.99) * (1 + 1e-4)
)  # blending stops where T would fall to 1e-4; one alpha of at most 0.99 may do that


def drawn(seed: int, n: int, size: float, opaque: bool):
    splats = scene(seed, n, 1, size)
    opacities = np.minimum(splats.opacities + (0.9 if opaque else 0.0), 1).astype(np.float32)
    splats = Splats(splats.means, splats.scales, splats.quaternions, opacities, splats.colours)
    return splats, RASTERISER.forward(splats, camera(29, 37, 40.0), np.zeros(1))


@given(st.integers(0, 9999), st.integers(0, 300), st.floats(1e-4, 0.3), st.booleans())
def test_weights_over_all_gaussians_are_what_the_background_lacks(seed, n, size, opaque) -> None:
    _, frame = drawn(seed, n, size, opaque)
    covered = 1 - frame.transmittance.astype(np.float64)
    rng = np.random.default_rng(seed)
    pixel_weights = rng.uniform(0, 1, (3, *covered.shape)).astype(np.float32)
    pixel_weights[0] = 1
    pixel_weights[1] = 0
    pixel_weights[1].flat[rng.integers(covered.size)] = 1  # one pixel alone
    sums = RASTERISER.colour_weights(frame, pixel_weights)
    assert (sums >= 0).all()
    expected = (covered * pixel_weights.astype(np.float64)).sum(axis=(1, 2))
    assert sums.sum(axis=0) == pytest.approx(expected, abs=SHARE * covered.size)
    assert sums[:, 1].sum() == pytest.approx(expected[1], abs=SHARE * max(n, 1))


@settings(max_examples=12)
@given(st.integers(0, 9999), st.integers(20, 150), st.floats(0.05, 0.4))
def test_what_stopping_early_leaves_out_is_less_than_a_hundredth_of_a_pixel(seed, n, size) -> None:
    """Against the compositor that never stops: T beyond its own is the remainder, and every pixel's is bounded by the theorem."""
    splats, frame = drawn(seed, n, size, opaque=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(raster_oracle, "STOP", 1e-300)
        leaves, depths = raster_oracle.parameters(splats), frame.bins.projection.depths[:n]
        whole = raster_oracle.draw(leaves, frame.camera, np.zeros(1), depths)
    stops = whole.transmittance.numpy() < 1e-4
    remainder = frame.transmittance - whole.transmittance.numpy()
    flips = 1 / 255 * (np.abs(whole.band) < 2e-5)  # a decision at alpha = 1/255
    assert (remainder > -1e-5 - flips).all()
    assert (remainder[stops] <= LEFT).all()
    assert (np.abs(remainder) <= 1e-5 + flips)[~stops & (whole.transmittance.numpy() > 1.1e-4)].all()
