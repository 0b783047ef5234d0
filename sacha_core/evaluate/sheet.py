"""A picture that sets renderings side by side, each with its title and its figures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from sacha_core.files import write_aside

__all__ = ["Panel", "write_sheet"]

INK = (32, 33, 36)
FAINT = (95, 99, 104)
GAP = 10
TITLE_SIZE = 17
CAPTION_SIZE = 14
LINE = 1.35  # line height over font size

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


@dataclass(frozen=True)
class Panel:
    """One picture of a sheet.

    Args:
        image: (h, w, 3) in [0, 1].
        title: one line above it.
        caption: lines below it.
        legend: (r, g, b) in [0, 1] with a text each, drawn below the caption.
    """

    image: Float[np.ndarray, "h w 3"]
    title: str
    caption: tuple[str, ...] = ()
    legend: tuple[tuple[tuple[float, float, float], str], ...] = ()


def write_sheet(path: str | os.PathLike[str], rows: Sequence[Sequence[Panel]]) -> None:
    """Write rows of panels as one PNG; panels of one row stand side by side, their tops aligned.

    Args:
        path: the PNG file.
        rows: at least one row with at least one panel.

    Raises:
        OSError: the file cannot be written.
    """
    title_font, caption_font = ImageFont.load_default(TITLE_SIZE), ImageFont.load_default(CAPTION_SIZE)
    heights = [max(_height(panel) for panel in row) for row in rows]
    width = max(sum(panel.image.shape[1] + GAP for panel in row) for row in rows) + GAP
    sheet = Image.new("RGB", (width, sum(heights) + GAP * (len(rows) + 1)), "white")
    pen = ImageDraw.Draw(sheet)
    top = GAP
    for row, height in zip(rows, heights, strict=True):
        left = GAP
        for panel in row:
            _draw(sheet, pen, panel, left, top, (title_font, caption_font))
            left += panel.image.shape[1] + GAP
        top += height + GAP
    with write_aside(path) as aside:
        sheet.save(aside, optimize=True)


def _height(panel: Panel) -> int:
    lines = len(panel.caption) + len(panel.legend)
    return round(TITLE_SIZE * LINE) + len(panel.image) + round(lines * CAPTION_SIZE * LINE) + GAP


def _draw(
    sheet: Image.Image,
    pen: ImageDraw.ImageDraw,
    panel: Panel,
    left: int,
    top: int,
    fonts: tuple[Font, Font],
) -> None:
    """Draw one panel with its upper left corner at (left, top)."""
    pen.text((left, top), panel.title, INK, fonts[0])
    top += round(TITLE_SIZE * LINE)
    pixels = np.round(np.clip(panel.image, 0, 1) * 255).astype(np.uint8)
    sheet.paste(Image.fromarray(pixels), (left, top))
    top += len(pixels) + GAP // 2
    for line in panel.caption:
        pen.text((left, top), line, FAINT, fonts[1])
        top += round(CAPTION_SIZE * LINE)
    for colour, text in panel.legend:
        swatch = tuple(round(255 * value) for value in colour)
        pen.rectangle((left, top + 2, left + CAPTION_SIZE, top + CAPTION_SIZE), fill=swatch, outline=FAINT)
        pen.text((left + CAPTION_SIZE + 6, top), text, FAINT, fonts[1])
        top += round(CAPTION_SIZE * LINE)
