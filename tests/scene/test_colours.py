"""Colours that say a number: the transfer function against its definition, the ramp against what a ramp must do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.scene.colours import count_legend, linear_colours, linear_count_colours

FLOAT32 = 1e-7  # relative: what storing in float32 costs
ONE_BYTE = (
    5e-4  # neighbours far up the ramp differ by rounding alone: blue may rise by a byte where red has not fallen yet
)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def test_srgb_is_decoded_as_its_standard_says() -> None:
    grey = np.arange(256, dtype=np.uint8)
    decoded = linear_colours(np.stack([grey] * 3, axis=1))
    expected = [v / 255 / 12.92 if v / 255 <= 0.04045 else ((v / 255 + 0.055) / 1.055) ** 2.4 for v in range(256)]
    assert decoded.dtype == np.float32
    assert np.allclose(decoded[:, :3], np.array(expected)[:, None], rtol=FLOAT32, atol=0)
    assert (decoded[:, 3] == 1).all()


def test_more_gaussians_are_darker_and_none_stands_apart() -> None:
    count = np.arange(1000)
    light = linear_count_colours(count)[:, :3] @ LUMINANCE
    assert (np.diff(light[1:]) <= ONE_BYTE).all()
    assert (np.diff(light[[1, 2, 5, 10, 20, 50, 100, 200, 500, 999]]) < 0).all()
    none, *rest = linear_count_colours(count)
    assert none[0] == none[1] == none[2]
    assert all(colour[0] != colour[2] for colour in rest)


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=50))
def test_every_count_has_a_colour_and_the_legend_shows_it(counts: list[int]) -> None:
    count = np.array(counts)
    colours = linear_count_colours(count)
    assert ((colours >= 0) & (colours <= 1)).all()
    legend = count_legend(int(count.max()))
    numbers = [int(line["label"].replace(",", "")) for line in legend]
    assert numbers == sorted(set(numbers))
    assert (numbers[0], numbers[-1]) == (0, count.max())
    assert legend[-1]["colour"] == pytest.approx(colours[count.argmax(), :3].tolist())


def test_a_head_without_gaussians_has_one_line_in_its_legend() -> None:
    assert [line["label"] for line in count_legend(0)] == ["0"]
    assert linear_count_colours(np.zeros(3, int)).shape == (3, 4)
