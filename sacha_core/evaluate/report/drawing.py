"""Making figures: size, fonts, axes, and files."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

from PIL import Image

from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.look import FAINT, GRID, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["MEDIUM", "PAGE_INCHES", "SMALL", "file_name", "new_figure", "picture", "tidy"]

PAGE_INCHES = 11.0  # drawn at 100 dots an inch it fills the page
SMALL, MEDIUM = 8.5, 10.0  # points
PNG_DOTS_PER_INCH = {True: 150, False: 120}  # made of lines, of pixels
COLOURS = 255
FONTS: Any = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib, so figures look the same everywhere
    "font.size": SMALL, "axes.titlesize": MEDIUM, "axes.labelsize": SMALL, "svg.fonttype": "path", "svg.hashsalt": "sacha",
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": FAINT, "xtick.color": FAINT, "ytick.color": FAINT,
}  # fmt: skip


def new_figure(height_inches: float, width_inches: float = PAGE_INCHES) -> Figure:
    """Give an empty figure of the page's width, in its fonts, that needs no display."""
    from matplotlib import rc_context  # noqa: PLC0415 (slow to import)
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure as NewFigure  # noqa: PLC0415

    with rc_context(FONTS):
        figure = NewFigure(figsize=(width_inches, height_inches), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: Axes, title: str, grid: Literal["both", "x", "y"] = "both") -> None:
    """Put a title above axes, leave of the frame what is needed, and put a faint grid behind the data."""
    axes.set_title(title, loc="left", fontsize=MEDIUM)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, which="major", axis=grid, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(length=3, labelsize=SMALL, colors=FAINT, labelcolor=INK)


def picture(figure: Figure, name: str, title: str, caption: str, lines: bool = True) -> Picture:
    """Give a figure as files: PNG, and SVG where it is made of lines."""
    from matplotlib import rc_context  # noqa: PLC0415 (slow to import)

    drawn, small, vector = io.BytesIO(), io.BytesIO(), io.BytesIO()
    with rc_context(FONTS):
        figure.savefig(drawn, format="png", dpi=PNG_DOTS_PER_INCH[lines])
        if lines:
            figure.savefig(vector, format="svg", metadata={"Date": None})
    image = Image.open(drawn).convert("RGB")
    if lines:  # flat inks: a palette takes a third of the bytes, and nobody sees it
        image = image.quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(small, "png", optimize=lines)
    return Picture(name, title, caption, small.getvalue(), vector.getvalue() if lines else None)


def file_name(text: str) -> str:
    """Give a text with what a file's name or a link should not hold made a dash."""
    return "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in text)
