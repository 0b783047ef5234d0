"""PSNR and SSIM against scikit-image, SciPy and naive loops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from sacha_core.perception.psnr import psnr
from sacha_core.perception.ssim import ssim

SAME_FORMULA = 1e-12  # both in float64
FLOAT32_WINDOWS = 2e-6  # blurred sums of 121 float32 products, averaged over the image
INSIDE_BORDER = 5e-6  # as above, over fewer pixels


def pair(seed: int, height: int = 30, width: int = 41) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    smooth = gaussian_filter(rng.random((height, width, 3)), (2, 2, 0))
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    return smooth, np.clip(smooth + rng.normal(0, 0.1, smooth.shape), 0, 1)


def test_psnr_is_that_of_scikit_image() -> None:
    a, b = pair(0)
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(a, b, data_range=1), rel=SAME_FORMULA)
    bytes_a, bytes_b = (np.rint(x * 255).astype(np.uint8) for x in (a, b))
    assert psnr(bytes_a, bytes_b) == pytest.approx(peak_signal_noise_ratio(bytes_a, bytes_b), rel=SAME_FORMULA)


def test_psnr_clamps_and_is_infinite_for_equal_images() -> None:
    a, _ = pair(1)
    assert psnr(a, a) == float("inf")
    assert psnr(np.full((4, 4, 3), 1.7), np.ones((4, 4, 3))) == float("inf")


@pytest.mark.parametrize("metric", [psnr, ssim])
def test_images_of_other_shapes_are_refused(metric) -> None:
    with pytest.raises(ValueError, match="shapes"):
        metric(np.zeros((4, 5, 3)), np.zeros((5, 4, 3)))


def naive_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Loop over pixels and taps in float64, zero padding."""
    taps = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    window = np.outer(taps, taps) / taps.sum() ** 2
    padded = [np.pad(x, ((5, 5), (5, 5), (0, 0))) for x in (a, b)]
    total = 0.0
    for y in range(a.shape[0]):
        for x in range(a.shape[1]):
            p, q = (image[y : y + 11, x : x + 11] for image in padded)
            mean_p, mean_q, pp, qq, pq = (np.tensordot(window, m, 2) for m in (p, q, p * p, q * q, p * q))
            luminance = (2 * mean_p * mean_q + 1e-4) / (mean_p**2 + mean_q**2 + 1e-4)
            contrast = (2 * (pq - mean_p * mean_q) + 9e-4) / (pp - mean_p**2 + qq - mean_q**2 + 9e-4)
            total += (luminance * contrast).mean()
    return total / (a.shape[0] * a.shape[1])


@pytest.mark.parametrize("size", [(13, 17), (1, 1), (3, 40), (40, 3)])
def test_ssim_is_that_of_a_naive_loop(size) -> None:
    a, b = (np.random.default_rng(2).random((2, *size, 3)) * 0.9).astype(np.float32)
    assert ssim(a, b) == pytest.approx(naive_ssim(a.astype(float), b.astype(float)), abs=FLOAT32_WINDOWS)


def test_ssim_is_that_of_scikit_image_away_from_the_border() -> None:
    # scikit-image reflects at borders and averages the inside only; so both are compared on images whose border is black
    a, b = (np.pad(x, ((10, 10), (10, 10), (0, 0))) for x in pair(3))
    options = {
        "gaussian_weights": True,
        "sigma": 1.5,
        "use_sample_covariance": False,
        "data_range": 1,
        "channel_axis": 2,
    }
    _, full = structural_similarity(a, b, full=True, **options)
    assert ssim(a, b) == pytest.approx(full.mean(), abs=INSIDE_BORDER)


@given(st.integers(0, 1000))
def test_ssim_is_symmetric_at_most_one_and_one_for_equal_images(seed) -> None:
    a, b = pair(seed, 17, 12)
    assert ssim(a, b) == pytest.approx(ssim(b, a), abs=FLOAT32_WINDOWS)
    assert ssim(a, b) < 1
    assert ssim(a, a) == pytest.approx(1, abs=FLOAT32_WINDOWS)
