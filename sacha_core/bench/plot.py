"""Drawing what a bench found."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from sacha_core.bench.growth import fit_growth
from sacha_core.bench.result import Bench, Panel, Row
from sacha_core.bench.table import cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw"]

# Told apart with any colour vision. Source: Okabe and Ito, Color Universal Design, 2008.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
COLUMNS = 2
PANEL_INCHES = (5.2, 3.9)
DOTS_PER_INCH = 100


def draw(bench: Bench, title: str) -> bytes:
    """Draw the panels of a bench as one PNG.

    Args:
        bench: what was found, with at least one panel.
        title: above all panels.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 (slow to import)
    from matplotlib.figure import Figure  # noqa: PLC0415

    columns = min(COLUMNS, len(bench.panels))
    lines = -(-len(bench.panels) // columns)
    figure = Figure(figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * lines), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for k, panel in enumerate(bench.panels):
        fill(figure.add_subplot(lines, columns, k + 1), panel, bench.of(panel))
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=DOTS_PER_INCH)
    return png.getvalue()


def fill(axes: Axes, panel: Panel, rows: list[Row]) -> None:
    """Draw one panel: points of each series with the quartiles, joined, and labelled."""
    floors = {"x": floor(rows, panel.x) if panel.log_x else None, "y": floor(rows, panel.y) if panel.log_y else None}
    for k, name in enumerate(dict.fromkeys(row.get(panel.series or "") for row in rows)):
        chosen = [row for row in rows if row.get(panel.series or "") == name]
        x, y = (along(chosen, key, floors[axis]) for axis, key in (("x", panel.x), ("y", panel.y)))
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        axes.errorbar(
            x, y, xerr=bars(chosen, panel.x, x), yerr=bars(chosen, panel.y, y), label=legend(panel, name, x, y),
            color=colour, marker=marker, markersize=5, linestyle="-" if panel.joined else "", linewidth=1.3, elinewidth=1, capsize=2,
        )  # fmt: skip
        if panel.label:
            for row, at_x, at_y in zip(chosen, x, y, strict=True):
                offset = (6, 4 if k % 2 == 0 else -11)
                axes.annotate(
                    cell(row[panel.label]),
                    (at_x, at_y),
                    xytext=offset,
                    textcoords="offset points",
                    fontsize=7.5,
                    color=colour,
                )
    finish(axes, panel, floors)


def finish(axes: Axes, panel: Panel, floors: dict[str, float | None]) -> None:
    """Set scales, titles, grid and legend."""
    axes.set_title(panel.title, fontsize=10)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.margins(x=0.14 if panel.label else 0.05, y=0.1)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.log_y:
        axes.set_yscale("log")
    for name, place in floors.items():
        if place is not None:
            line, axis = (axes.axvline, axes.xaxis) if name == "x" else (axes.axhline, axes.yaxis)
            line(place, color="#999999", linewidth=0.8, linestyle=":")
            axis.set_major_formatter(_ticks(place))
            axis.set_ticks([place, *(tick for tick in axis.get_majorticklocs() if tick > 2 * place)])
    if panel.series:
        axes.legend(fontsize=7.5, title_fontsize=7.5, framealpha=0.85)


def legend(panel: Panel, name: object, x: np.ndarray, y: np.ndarray) -> str | None:
    """Name a series, and its fitted exponent where the panel asks for it."""
    text = cell(name)
    if panel.growth and len(np.unique(x)) > 1:
        text += f"  ~ size^{fit_growth(list(x), list(y))}"
    return text or None


def along(rows: list[Row], key: str, lowest: float | None) -> np.ndarray:
    """Give the values along an axis, zeros at the line kept for them."""
    values = np.array([row[key] for row in rows], float)
    return values if lowest is None else np.maximum(values, lowest)


def bars(rows: list[Row], key: str, values: np.ndarray) -> np.ndarray | None:
    """Give the distances of the quartiles; None where the rows have none."""
    stem = key.removesuffix("_ms")
    quartiles = [[row.get(f"{stem}_q1_ms"), row.get(f"{stem}_q3_ms")] for row in rows]
    if stem == key or any(q is None for pair in quartiles for q in pair):
        return None
    low, high = np.array(quartiles, float).T
    return np.stack([np.maximum(values - low, 0), np.maximum(high - values, 0)])


def floor(rows: list[Row], key: str) -> float | None:
    """Give the place kept for zeros on a logarithmic axis, a decade below the smallest other value; None where there are no zeros."""
    values = np.array([row[key] for row in rows], float)
    if (values > 0).all() or not (values > 0).any():
        return None
    return float(10 ** (np.floor(np.log10(values[values > 0].min())) - 1))


def _ticks(zero: float) -> Any:
    from matplotlib.ticker import FuncFormatter  # noqa: PLC0415

    return FuncFormatter(lambda value, _: "0" if value <= 1.01 * zero else f"$10^{{{np.log10(value):.0f}}}$")
