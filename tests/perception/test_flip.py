"""FLIP against its paper, written out plainly in float64 with SciPy's correlation, and against what follows from its definition."""

from __future__ import annotations

import numpy as np
import pytest
from flip_evaluator import evaluate
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import correlate, gaussian_filter

from sacha_core.errors import OptionError
from sacha_core.perception import flip as module
from sacha_core.perception.flip import PIXELS_PER_DEGREE, flip, flip_map

FLOAT32_COLOURS = (
    2e-4  # the package goes through four colour spaces, cube roots and powers of small differences in float32
)
TO_XYZ = np.linalg.inv(  # of linear sRGB, D65
    np.array(
        [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
    )
)
WHITE = TO_XYZ @ np.ones(3)


def lab(xyz: np.ndarray) -> np.ndarray:
    ratio = xyz / WHITE
    delta = 6 / 29
    f = np.where(ratio > delta**3, np.cbrt(ratio), ratio / (3 * delta**2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def hunt(colours: np.ndarray) -> np.ndarray:
    """Let colours count the less, the darker they are."""
    lightness = colours[..., :1]
    return np.concatenate([lightness, 0.01 * lightness * colours[..., 1:]], -1)


def hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """City-block distance in lightness, Euclidean in chroma."""
    return np.abs(a[..., 0] - b[..., 0]) + np.hypot(a[..., 1] - b[..., 1], a[..., 2] - b[..., 2])


def grid(radius: int) -> tuple[np.ndarray, np.ndarray]:
    return tuple(np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(float)[::-1])


def seen_colours(linear: np.ndarray, ppd: float) -> np.ndarray:
    """Blur as the eye does in an opponent space, and give Hunt-adjusted CIELAB (the paper's section 4.1)."""
    x, y, z = np.moveaxis(linear @ TO_XYZ.T / WHITE, -1, 0)
    opponent = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
    across, down = grid(int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi**2)) * ppd)))
    squared = (across**2 + down**2) / ppd**2
    waves = (((1, 0.0047),), ((1, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
    for channel, parts in enumerate(waves):
        window = sum(a * np.sqrt(np.pi / b) * np.exp(-(np.pi**2) * squared / b) for a, b in parts)
        opponent[..., channel] = correlate(opponent[..., channel], window / window.sum(), mode="nearest")
    y = (opponent[..., 0] + 16) / 116
    xyz = np.stack([y + opponent[..., 1] / 500, y, y - opponent[..., 2] / 200], -1) * WHITE
    clamped = np.clip(xyz @ np.linalg.inv(TO_XYZ).T, 0, 1)
    return hunt(lab(clamped @ TO_XYZ.T))


def colour_error(a: np.ndarray, b: np.ndarray, ppd: float) -> np.ndarray:
    green, blue = (hunt(lab(TO_XYZ @ colour)) for colour in (np.array([0.0, 1, 0]), np.array([0.0, 0, 1])))
    largest = hyab(green, blue) ** 0.7
    error = hyab(seen_colours(a, ppd), seen_colours(b, ppd)) ** 0.7
    knee = 0.4 * largest
    return np.where(error < knee, 0.95 / knee * error, 0.95 + (error - knee) / (largest - knee) * 0.05)


def feature_error(a: np.ndarray, b: np.ndarray, ppd: float) -> np.ndarray:
    """Compare strengths of edges and points in luminance (the paper's section 4.2)."""
    deviation = 0.5 * 0.082 * ppd
    across, down = grid(int(np.ceil(3 * deviation)))
    bell = np.exp(-(across**2 + down**2) / (2 * deviation**2))
    strengths = []
    for window in (-across * bell, (across**2 / deviation**2 - 1) * bell):
        window[window > 0] /= window[window > 0].sum()
        window[window < 0] /= -window[window < 0].sum()
        for linear in (a, b):
            y = (linear @ TO_XYZ.T)[..., 1]
            strengths.append(np.hypot(correlate(y, window, mode="nearest"), correlate(y, window.T, mode="nearest")))
    edge_a, edge_b, point_a, point_b = strengths
    return np.sqrt(np.maximum(np.abs(edge_a - edge_b), np.abs(point_a - point_b)) / np.sqrt(2))


def plain_flip(a: np.ndarray, b: np.ndarray, ppd: float = PIXELS_PER_DEGREE) -> np.ndarray:
    linear = [
        np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) for x in (a.astype(float), b.astype(float))
    ]
    return colour_error(*linear, ppd) ** (1 - feature_error(*linear, ppd))


def pair(seed: int, height: int = 60, width: int = 75) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    smooth = gaussian_filter(rng.random((height, width, 3)), (3, 3, 0))
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    noise = gaussian_filter(rng.normal(0, 0.4, smooth.shape), (1, 1, 0))
    return smooth.astype(np.float32), np.clip(smooth + noise, 0, 1).astype(np.float32)


@pytest.mark.parametrize("ppd", [PIXELS_PER_DEGREE, 31.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_pixel_is_as_the_paper_says(seed, ppd) -> None:
    a, b = pair(seed)
    expected = plain_flip(a, b, ppd)
    assert 0.05 < expected.mean() < 0.8
    np.testing.assert_allclose(flip_map(a, b, ppd), expected, atol=FLOAT32_COLOURS)


@given(top=st.integers(0, 90), left=st.integers(0, 110), height=st.integers(1, 6), width=st.integers(1, 6))
def test_comparing_only_where_images_differ_changes_nothing(top, left, height, width) -> None:
    """Oracle: the package over the whole image."""
    a, _ = pair(2, 90, 110)
    b = a.copy()
    b[top : top + height, left : left + width] = 1 - b[top : top + height, left : left + width]
    whole = evaluate(a, b, "LDR", True, False, True, {"ppd": PIXELS_PER_DEGREE})
    np.testing.assert_array_equal(flip_map(b, a), whole[0][..., 0])
    assert flip(b, a) == pytest.approx(whole[1], rel=1e-4)  # the package sums in float32


def test_black_against_white_is_as_bad_as_it_gets_and_equal_images_are_perfect() -> None:
    a, b = pair(3)
    assert flip(a, a) == 0
    assert flip_map(a, a).shape == a.shape[:2]
    black, white = np.zeros((40, 40, 3), np.float32), np.ones((40, 40, 3), np.float32)
    assert 0.95 < flip(black, white) <= 1
    errors = flip_map(a, b)
    assert errors.dtype == np.float32
    assert 0 <= errors.min() <= errors.max() <= 1
    np.testing.assert_allclose(errors, flip_map(b, a), atol=FLOAT32_COLOURS)


def test_bytes_are_taken_as_they_are_and_light_beyond_the_range_is_clamped() -> None:
    a, b = pair(4)
    bytes_a, bytes_b = (np.rint(x * 255).astype(np.uint8) for x in (a, b))
    np.testing.assert_array_equal(flip_map(bytes_a, bytes_b), flip_map(bytes_a / 255.0, bytes_b / np.float32(255)))
    np.testing.assert_array_equal(flip_map(a * 1.5, b), flip_map(np.clip(a * 1.5, 0, 1), b))


def test_more_noise_is_worse() -> None:
    a, b = pair(5)
    steps = [flip(a + step * (b - a), a) for step in (0.1, 0.3, 1.0)]
    assert steps == sorted(steps)


def test_images_of_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="shapes"):
        flip_map(np.zeros((4, 5, 3)), np.zeros((5, 4, 3)))


def test_without_the_package_it_is_said_how_to_get_it(monkeypatch) -> None:
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda _: None)
    a, b = pair(6)
    with pytest.raises(OptionError, match=r"pip install .*flip-evaluator"):
        flip_map(a, b)
