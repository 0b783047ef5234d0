"""Errors as numbers and as a picture. Oracles: definitions by hand, and relative luminance as IEC 61966-2-1 has it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sacha_core.perception.difference import covered_psnr, error_colours, error_legend, pixel_error
from sacha_core.perception.psnr import psnr

RNG = np.random.default_rng(5)


def luminance(srgb: np.ndarray) -> np.ndarray:
    encoded = srgb / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def test_the_channel_that_differs_most_is_the_error() -> None:
    one, other = np.zeros((1, 2, 3), np.uint8), np.zeros((1, 2, 3), np.uint8)
    other[0, 0] = (51, 10, 0)
    np.testing.assert_allclose(pixel_error(one, other), [[51 / 255, 0]], rtol=1e-6)
    with pytest.raises(ValueError, match="cannot be compared"):
        pixel_error(one, other[:, :1])


def test_more_error_is_always_lighter_and_none_is_black() -> None:
    steps = np.linspace(0, 0.1, 60, dtype=np.float32)[None]  # finer ones differ by a byte, of blue alone now and then
    painted = error_colours(steps, 0.1)[0]
    assert tuple(painted[0]) == (0, 0, 0)
    light = luminance(painted.astype(float))
    assert (np.diff(light) > 0).all()
    assert light[-1] > 0.9
    assert (error_colours(np.array([[0.1, 0.2, 5.0]], np.float32), 0.1) == painted[-1]).all()


def test_the_legend_has_the_colours_that_are_painted() -> None:
    values, colours = zip(*error_legend(0.4), strict=True)
    assert (values[0], values[-1]) == (0, 0.4)
    assert np.array_equal(error_colours(np.array([values], np.float32), 0.4)[0], colours)


def test_an_empty_background_makes_nothing_better() -> None:
    truth = RNG.random((8, 8, 3))
    image = truth.copy()
    image[2:4, 2:4] = np.clip(image[2:4, 2:4] + 0.1, 0, 1)
    covered = np.zeros((8, 8), bool)
    covered[2:4, 2:4] = True
    assert covered_psnr(image, truth, covered) == pytest.approx(psnr(image[2:4, 2:4], truth[2:4, 2:4]))
    assert psnr(image, truth) == pytest.approx(covered_psnr(image, truth, covered) + 10 * math.log10(16))
    assert covered_psnr(image, truth, ~covered) == math.inf
    assert covered_psnr(image, truth, np.zeros_like(covered)) == math.inf
