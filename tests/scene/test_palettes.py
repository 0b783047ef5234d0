"""Palettes as people see them whose eyes lack cones, by the projections of Vienot, Brettel and Mollon and CIE's colour differences."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.color import rgb2lab

from sacha_core.scene.palettes import DIVERGING, MAGNITUDE, MIDDLE, STEPS, palette_bytes

# Linear-RGB projections onto what dichromats see: Vienot, Brettel and Mollon 1999; and a print in grey: the luminance of IEC 61966-2-1
VIEWERS = {
    "all cones": np.eye(3),
    "protanope": np.array([[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]]),
    "deuteranope": np.array([[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]),
    "print in grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
TELLABLE = 10.0  # a difference in CIELAB that is seen at a glance, far above the 2.3 that are just noticed
ONE_BYTE = 0.5  # of lightness: neighbours are rounded to whole bytes
DICHROMATS = ("all cones", "protanope", "deuteranope")


def seen(name: str, viewer: str) -> np.ndarray:
    """Give a palette in CIELAB as a viewer sees it."""
    srgb = palette_bytes(name) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4) @ VIEWERS[viewer].T
    shown = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.clip(linear, 1e-9, None) ** (1 / 2.4) - 0.055)
    return np.asarray(rgb2lab(np.clip(shown, 0, 1)))


@pytest.mark.parametrize("viewer", VIEWERS)
def test_more_is_darker_to_everybody(viewer: str) -> None:
    light = seen(MAGNITUDE, viewer)[1:, 0]
    assert len(light) == STEPS
    assert (np.diff(light) < ONE_BYTE).all()
    eighths = light[:: STEPS // 8]
    assert (np.diff(eighths) < -TELLABLE / 4).all()
    assert light[0] - light[-1] > 6 * TELLABLE


@pytest.mark.parametrize("viewer", DICHROMATS)
def test_none_is_told_from_little(viewer: str) -> None:
    for name in (MAGNITUDE, DIVERGING):
        lab = seen(name, viewer)
        nearest = np.linalg.norm(lab[1:] - lab[0], axis=1).min()
        assert nearest > TELLABLE / 2, (name, nearest)


@pytest.mark.parametrize("viewer", DICHROMATS)
def test_less_and_more_are_told_apart_at_every_size(viewer: str) -> None:
    lab = seen(DIVERGING, viewer)
    for off in range(8, MIDDLE):
        assert np.linalg.norm(lab[MIDDLE - off] - lab[MIDDLE + off]) > TELLABLE, off


@pytest.mark.parametrize("viewer", VIEWERS)
def test_the_further_from_no_change_the_darker(viewer: str) -> None:
    light = seen(DIVERGING, viewer)[:, 0]
    assert light[1:].argmax() + 1 == MIDDLE
    assert (np.diff(light[MIDDLE:]) < ONE_BYTE).all()
    assert (np.diff(light[1 : MIDDLE + 1]) > -ONE_BYTE).all()


def test_no_change_is_the_middle_of_the_palette() -> None:
    assert np.array_equal(palette_bytes(DIVERGING)[MIDDLE], [247, 247, 245])
    assert len(palette_bytes(DIVERGING)) == len(palette_bytes(MAGNITUDE)) == STEPS + 1
