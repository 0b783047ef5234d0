"""What drawing leaves out changes no bit. Oracle: the same drawing with nothing left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sacha_core.bench.scenes import front_camera, head_shell
from sacha_core.perception.image_loss import ImageLoss
from sacha_core.raster.harmonics import degrees_in_use, sh_colours
from sacha_core.raster.rasteriser import Frame, Rasteriser
from sacha_core.raster.splats import Splats

WHITE = np.array([1, 1, 1, 0], np.float32)
CAMERA = front_camera(150, 190)
REACH = 10  # pixels: of a pixel in another's gradient of SSIM
NAMES = ("means", "scales", "quaternions", "opacities", "colours")
ORDER = 1e-6  # relative: the same float32 terms added in another order


@pytest.fixture(scope="module")
def rasteriser() -> Rasteriser:
    return Rasteriser(threads=2)


def pulls(rasteriser: Rasteriser, frame: Frame, upstream: np.ndarray) -> dict[str, np.ndarray]:
    """Give copies of the gradients, whose memory belongs to the rasteriser."""
    found = rasteriser.backward(frame, upstream)
    return {name: getattr(found, name).copy() for name in NAMES}


def test_crop(rasteriser: Rasteriser) -> None:
    """Inside it every bit of image and gradient is that of the whole, outside all is background, and costs its share of the loss."""
    splats = head_shell(3000)
    whole = rasteriser.forward(splats, CAMERA, WHITE).image.copy()
    rows, columns = (np.flatnonzero((whole != WHITE[:, None, None]).any(axis=(0, axis))) for axis in (2, 1))
    top, bottom = max(rows[0] - REACH, 0), min(rows[-1] + 1 + REACH, CAMERA.height)
    left, right = max(columns[0] - REACH, 0), min(columns[-1] + 1 + REACH, CAMERA.width)
    inside = np.s_[..., top:bottom, left:right]
    assert (bottom - top) * (right - left) < 0.8 * CAMERA.width * CAMERA.height
    part = rasteriser.forward(splats, CAMERA.crop(left, top, right - left, bottom - top), WHITE)
    assert np.array_equal(part.image, whole[inside])
    outside = np.ones(whole.shape, bool)
    outside[inside] = False
    assert np.array_equal(whole[outside], np.broadcast_to(WHITE[:, None, None], whole.shape)[outside])

    rng = np.random.default_rng(0)
    target, sensitivity = np.full((3, CAMERA.height, CAMERA.width), 255, np.uint8), np.zeros(whole.shape[1:], np.uint8)
    shown = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    target[:, *shown] = rng.integers(0, 256, target[:, *shown].shape)
    sensitivity[shown] = rng.integers(0, 256, sensitivity[shown].shape)
    everything = ImageLoss()(whole, target, sensitivity)
    cropped = ImageLoss()(part.image, target, sensitivity, (left, top, right, bottom))
    assert np.array_equal(cropped.gradient, everything.gradient[inside])
    assert not everything.gradient[outside].any()
    for name in ("total", "l1", "ssim", "entropy"):
        assert getattr(cropped, name) == pytest.approx(getattr(everything, name), rel=ORDER), name


def test_gaussians_out_of_sight(rasteriser: Rasteriser) -> None:
    """Behind the camera, beside the image, too faint, or not finite: the others are drawn, and pulled, as if these were not there."""
    n = 2000
    seen, rng = head_shell(n), np.random.default_rng(1)
    towards = np.asarray(CAMERA.centre, np.float32)
    hidden = {
        "behind": replace(seen, means=seen.means + 2 * towards),
        "beside": replace(seen, means=seen.means + np.float32([3, 0, 0])),
        "faint": replace(seen, opacities=np.full(n, 0.9 / 255, np.float32)),
        "endless": replace(seen, scales=np.full((n, 3), np.inf, np.float32)),
    }
    mixed = np.argsort(np.concatenate([np.arange(n), rng.integers(0, n, 4 * n)]), kind="stable")
    everything = Splats(*(np.concatenate([getattr(s, k) for s in (seen, *hidden.values())])[mixed] for k in NAMES))
    upstream = rng.normal(size=(4, CAMERA.height, CAMERA.width)).astype(np.float32)
    alone = rasteriser.forward(seen, CAMERA, WHITE)
    picture, slopes = alone.image.copy(), pulls(rasteriser, alone, upstream)
    assert picture.std() > 0.1
    frame = rasteriser.forward(everything, CAMERA, WHITE)
    assert np.array_equal(frame.image, picture)
    there = mixed < n
    for name, slope in pulls(rasteriser, frame, upstream).items():
        assert np.array_equal(slope[there], slopes[name]), name
        assert not slope[~there].any(), name


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_inactive_harmonics(degree: int) -> None:
    """Coefficients beyond the degree in use are not read, as if the array ended there."""
    dc, rest, means = (
        np.random.default_rng(2).normal(size=s).astype(np.float32) for s in ((500, 3), (500, 15, 3), (500, 3))
    )
    inactive = (degree + 1) ** 2 - 1
    rest[:, inactive:] = np.nan
    centre = np.array([0.1, 0.2, 1.5], np.float32)
    cut = sh_colours(dc, np.ascontiguousarray(rest[:, :inactive]), means, centre, degree)
    assert np.array_equal(sh_colours(dc, rest, means, centre, degree), cut)
    assert cut.std() > 0.1


def test_harmonics_that_are_zero() -> None:
    """A Gaussian whose coefficients are zero from some degree on has the same colour with them and without."""
    rng = np.random.default_rng(3)
    dc, rest, means = (rng.normal(size=s).astype(np.float32) for s in ((500, 3), (500, 15, 3), (500, 3)))
    degrees = rng.integers(0, 4, 500).astype(np.uint8)
    for row, degree in zip(rest, degrees, strict=True):
        row[(int(degree) + 1) ** 2 - 1 :] = 0
    assert np.array_equal(degrees_in_use(rest), degrees)
    centre = np.array([0.1, 0.2, 1.5], np.float32)
    spelled_out = sh_colours(dc, rest, means, centre, 3)
    for row, degree in zip(rest, degrees, strict=True):
        row[(int(degree) + 1) ** 2 - 1 :] = np.nan  # not even looked at
    assert np.array_equal(sh_colours(dc, rest, means, centre, 3, degrees=degrees), spelled_out)


def test_sensitivity_channel(rasteriser: Rasteriser) -> None:
    """Without it, as outside training, colours and what pulls on the Gaussians by them have the same bits."""
    four = head_shell(3000, 4)
    three = replace(four, colours=np.ascontiguousarray(four.colours[:, :3]))
    upstream = np.random.default_rng(4).normal(size=(4, CAMERA.height, CAMERA.width)).astype(np.float32)
    upstream[3] = 0
    frame = rasteriser.forward(four, CAMERA, WHITE)
    picture, slopes = frame.image[:3].copy(), pulls(rasteriser, frame, upstream)
    frame = rasteriser.forward(three, CAMERA, WHITE[:3])
    assert np.array_equal(frame.image, picture)
    slopes["colours"] = slopes["colours"][:, :3]
    for name, slope in pulls(rasteriser, frame, upstream[:3]).items():
        assert np.array_equal(slope, slopes[name]), name
