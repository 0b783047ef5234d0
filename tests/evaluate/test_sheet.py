"""Sheets of pictures: every pixel of a panel arrives where it belongs."""

from __future__ import annotations

import numpy as np
from PIL import Image

from sacha_core.evaluate.sheet import Panel, write_sheet


def holds(sheet, image):
    """Tell whether the picture occurs in the sheet, pixel for pixel (the naive search)."""
    pixels = np.round(image * 255).astype(np.uint8)
    h, w = pixels.shape[:2]
    first = np.all(sheet == pixels[0, 0], axis=2)
    return any(np.array_equal(sheet[y : y + h, x : x + w], pixels) for y, x in zip(*np.nonzero(first), strict=True))


def test_panels_of_unequal_rows_are_all_there_unchanged(tmp_path):
    rng = np.random.default_rng(0)
    images = [rng.random((h, w, 3), np.float32) for h, w in ((40, 30), (25, 50), (33, 20))]
    rows = [
        [Panel(images[0], "one", ("a", "b")), Panel(images[1], "two")],
        [Panel(images[2], "three", (), (((1.0, 0.0, 0.0), "red"),))],
    ]
    write_sheet(tmp_path / "sheet.png", rows)
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert all(holds(sheet, image) for image in images)
    assert np.any(np.all(sheet == (255, 0, 0), axis=2)), "the legend's swatch"


def test_values_outside_the_range_are_clipped(tmp_path):
    image = np.array([[[-1.0, 0.5, 2.0]]], np.float32).repeat(8, 0).repeat(8, 1)
    write_sheet(tmp_path / "sheet.png", [[Panel(image, "")]])
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert holds(sheet, np.clip(image, 0, 1))
