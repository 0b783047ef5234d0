"""Errors of pictures against the exact compositor on the whole image, which the patches must agree with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.bench.exact import draw, leaves_of
from sacha_core.bench.picture_error import BAND, _discs, _reaches, picture_error
from sacha_core.bench.scenes import front_camera, head_shell
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.splats import Splats

SAME = 1e-12  # float64 sums in another order
PIXEL = 2e-5  # float32 rounding of some tens of blended terms, as in the tests of the rasteriser
WHITE = np.ones(3)


def exact_picture(splats: Splats, camera, depths: np.ndarray) -> np.ndarray:
    return draw(leaves_of(splats), camera, WHITE, depths).image.numpy()


@pytest.fixture(scope="module")
def drawn():
    splats, camera = head_shell(400, channels=3), front_camera(48, 70)
    frame = Rasteriser(1).forward(splats, camera, WHITE)
    return splats, camera, frame.bins.projection.depths[:400].copy(), frame.image.copy()


def test_the_exact_picture_has_no_error(drawn) -> None:
    splats, camera, depths, _ = drawn
    error = picture_error(exact_picture(splats, camera, depths), splats, camera, WHITE, depths, n_patches=40)
    assert max(error.largest, error.mean) < SAME
    assert error.n_pixels == 40 * 64


def test_what_is_added_to_a_picture_is_its_error(drawn) -> None:
    splats, camera, depths, _ = drawn
    image = exact_picture(splats, camera, depths)
    image[1] += 0.25
    error = picture_error(image, splats, camera, WHITE, depths)
    assert error.largest == pytest.approx(0.25)
    assert error.mean == pytest.approx(0.25 / 3)


def test_no_gaussian_that_shows_in_a_patch_is_left_out() -> None:
    """Discs are generous: with all Gaussians a patch is the same. Large, small, near and far ones, some behind the camera."""
    rng = np.random.default_rng(0)
    n = 300
    splats = Splats(
        rng.normal(size=(n, 3)) * (0.3, 0.3, 0.8),
        np.exp(rng.normal(-4, 1.5, (n, 3))),
        rng.normal(size=(n, 4)),
        rng.uniform(0, 1, n),
        rng.uniform(0, 1, (n, 3)),
    )
    camera = front_camera(60, 44)
    depths = (splats.means @ camera.rotation[2] + camera.translation[2]).astype(np.float32)
    whole = exact_picture(splats, camera, depths)
    for left, top in ((0, 0), (20, 13), (52, 36), (33, 2)):
        reach = _reaches(*_discs(splats, camera), left, top, 8, 8)
        some = Splats(
            *(getattr(splats, name)[reach] for name in ("means", "scales", "quaternions", "opacities", "colours"))
        )
        patch = exact_picture(some, camera.crop(left, top, 8, 8), depths[reach])
        assert np.abs(patch - whole[:, top : top + 8, left : left + 8]).max() < SAME
    assert not reach.all()


def test_the_rasteriser_is_right_outside_the_band(drawn) -> None:
    splats, camera, depths, image = drawn
    error = picture_error(image, splats, camera, WHITE, depths, n_patches=40)
    assert 0 < error.largest < PIXEL
    assert error.n_in_band < 0.02 * error.n_pixels


def test_a_decision_at_a_threshold_counts_apart() -> None:
    """One Gaussian whose alpha at a pixel is 1/255 to within the band: drawn or not, that pixel's error is not taken for the picture's."""
    camera = front_camera(8, 8)
    opacity = (1 + BAND / 2) / 255
    one = head_shell(1, channels=3)
    splats = replace(
        one,
        means=np.zeros((1, 3)),
        scales=np.full((1, 3), 10.0),
        opacities=np.array([opacity]),
        colours=np.zeros((1, 3)),
    )
    depths = np.ones(1, np.float32)
    undecided = np.abs(draw(leaves_of(splats), camera, WHITE, depths).band) < BAND
    assert undecided.any()
    without = np.ones((3, 8, 8))
    error = picture_error(without, splats, camera, WHITE, depths, n_patches=1)
    assert error.n_in_band == undecided.sum()
    assert error.largest_in_band == pytest.approx(1 / 255, rel=1e-3)


def test_pictures_smaller_than_a_patch() -> None:
    splats, camera = head_shell(50, channels=3), front_camera(5, 3)
    depths = (splats.means @ camera.rotation[2] + camera.translation[2]).astype(np.float32)
    error = picture_error(exact_picture(splats, camera, depths), splats, camera, WHITE, depths, n_patches=2)
    assert error.largest < SAME
    assert error.n_pixels == 30
