"""The reference sensitivity map against a naive loop in float64, and its laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sacha_core.perception.sensitivity_map import resized_sensitivity, sensitivity_map


def naive(image: np.ndarray, pad: str) -> np.ndarray:
    """Do as the method says, pixel by pixel."""
    luma = np.asarray(Image.fromarray(image).convert("L")) / 255.0
    luma = np.rint(255 * luma ** (1 / 1.5)) / 255
    around = np.pad(luma, 1, mode="edge" if pad == "replicate" else "constant")
    kernel = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    height, width = luma.shape
    edge = np.zeros(luma.shape, bool)
    for y in range(height):
        for x in range(width):
            patch = around[y : y + 3, x : x + 3]
            edge[y, x] = np.hypot((patch * kernel).sum(), (patch * kernel.T).sum()) > 0.05
    rows, columns = height // 5, width // 5
    result = np.zeros(luma.shape, bool)
    for y in range(height):
        for x in range(width):
            row, column = int(y * rows / height), int(x * columns / width)
            result[y, x] = edge[5 * row : 5 * row + 5, 5 * column : 5 * column + 5].mean() > 0.3
    return result


@pytest.mark.parametrize("pad", ["zero", "replicate"])
def test_map_is_that_of_a_naive_loop(pad) -> None:
    rng = np.random.default_rng(0)
    image = np.full((43, 57, 3), 255, np.uint8)
    image[10:30, 12:40] = rng.integers(0, 256, (20, 28, 3))
    image[33:, 30:] = np.linspace(0, 60, 27, dtype=np.uint8)[None, :, None]
    found = sensitivity_map(image, pad)
    assert np.array_equal(found, naive(image, pad))
    assert found.any()
    assert not found.all()


def test_faint_noise_of_which_the_gamma_decides_what_is_an_edge() -> None:
    image = np.repeat(np.random.default_rng(3).integers(100, 109, (80, 80, 1), np.uint8), 3, axis=2)
    found = sensitivity_map(image)
    assert 0.2 < found.mean() < 0.8
    assert np.array_equal(found, naive(image, "replicate"))


def test_a_white_image_has_two_false_corners_under_zero_padding_and_none_under_replication() -> None:
    white = np.full((802, 550, 3), 255, np.uint8)
    assert not sensitivity_map(white, "replicate").any()
    zero = sensitivity_map(white, "zero")
    corners = np.zeros_like(zero)
    corners[:6, :5] = corners[:6, -5:] = True  # 160 rows of blocks over 802 pixels: the first is six pixels high
    assert np.array_equal(zero, corners)


@given(st.integers(0, 255))
def test_any_flat_image_is_insensitive(grey) -> None:
    assert not sensitivity_map(np.full((20, 25, 3), grey, np.uint8)).any()


def test_mirroring_an_image_of_whole_blocks_mirrors_its_map() -> None:
    image = np.random.default_rng(1).integers(0, 40, (40, 60, 3), np.uint8) * 3
    assert np.array_equal(sensitivity_map(image)[:, ::-1], sensitivity_map(np.ascontiguousarray(image[:, ::-1])))


@pytest.mark.parametrize("size", [(4, 50), (50, 4), (1, 1)])
def test_an_image_smaller_than_a_block_is_insensitive(size) -> None:
    image = np.random.default_rng(2).integers(0, 256, (*size, 3), np.uint8)
    assert not sensitivity_map(image).any()


def test_resizing_keeps_a_map_of_the_right_size_and_shares_when_shrinking() -> None:
    sensitive = np.zeros((40, 30), bool)
    sensitive[10:20, 5:15] = True
    same = resized_sensitivity(sensitive, 30, 40)
    assert np.array_equal(same, sensitive * np.uint8(255))
    half = resized_sensitivity(sensitive, 15, 20)
    assert half.shape == (20, 15)
    assert half.sum() / 255 == pytest.approx(sensitive.sum() / 4, rel=0.02)  # bicubic overshoot is cut off at 0 and 255
