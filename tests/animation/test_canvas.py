"""Oracle: a fresh picture of background with the planes put in by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from sacha_core.animation.canvas import Canvas
from sacha_core.errors import OptionError
from sacha_core.parallel.pool import Pool

BACKGROUND = np.array([0.2, 0.5, 1.25])


def expected(planes: np.ndarray, left: int, top: int, width: int, height: int, dtype: type) -> np.ndarray:
    whole = np.empty((height, width, 3), np.float32)
    whole[:] = BACKGROUND
    whole[top : top + planes.shape[1], left : left + planes.shape[2]] = planes.transpose(1, 2, 0)
    return np.round(np.clip(whole, 0, 1) * np.float32(255)).astype(np.uint8) if dtype is np.uint8 else whole


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_pictures_hold_what_was_drawn_last_and_nothing_from_before(dtype: type, threads: int) -> None:
    rng = np.random.default_rng(0)
    canvas = Canvas(BACKGROUND, dtype, Pool(threads))
    width, height, before = 31, 23, None
    for k in range(60):
        if k == 40:
            width, height = 17, 40
        sides = np.sort(rng.integers(0, width + 1, 2)), np.sort(rng.integers(0, height + 1, 2))
        (left, right), (top, bottom) = sides
        planes = rng.uniform(-0.3, 1.3, (3, bottom - top, right - left)).astype(np.float32)
        picture = canvas.show(planes, left, top, width, height)
        wanted = expected(planes, left, top, width, height, dtype)
        np.testing.assert_array_equal(picture, wanted)
        if before is not None:
            np.testing.assert_array_equal(before[0], before[1], err_msg="the picture before is still to be seen")
        before = picture, wanted


def test_bytes_are_rounded_to_the_nearest_and_halves_to_the_even() -> None:
    values = np.array([0, 0.5, 1.5, 2.5, 254.5, 255, 300, -3, 0.49999], np.float32) / 255
    canvas = Canvas(np.zeros(3), np.uint8, Pool(1))
    picture = canvas.show(np.broadcast_to(values, (3, 1, len(values))).copy(), 0, 0, len(values), 1)
    np.testing.assert_array_equal(picture[0, :, 0], np.round(np.clip(values, 0, 1) * np.float32(255)))


def test_pictures_are_not_to_be_written_to() -> None:
    picture = Canvas(BACKGROUND, np.uint8, Pool(1)).show(np.zeros((3, 2, 2), np.float32), 1, 1, 5, 5)
    with pytest.raises(ValueError, match="read-only"):
        picture[0] = 0


@pytest.mark.parametrize(
    ("background", "dtype"), [(BACKGROUND, np.float64), (np.zeros(4), np.uint8), (BACKGROUND * np.nan, np.uint8)]
)
def test_what_makes_no_picture(background: np.ndarray, dtype: type) -> None:
    with pytest.raises(OptionError, match="expected"):
        Canvas(background, dtype, Pool(1))
