"""Drawing what a bench found."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from PIL import Image

from sacha_core.bench.growth import LARGEST, fit_growth
from sacha_core.bench.labels import Spot, place_labels
from sacha_core.bench.result import Bench, Panel, Row
from sacha_core.bench.table import cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

__all__ = ["draw"]

# Told apart with any colour vision. Source: Okabe and Ito, Color Universal Design, 2008.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#808080", "#A05A2C", "#6A3D9A")
MARKERS = "osD^vPX*h<"
COLUMNS = 2
PANEL_INCHES = (5.4, 4.1)
DOTS_PER_INCH = 90
SMALL = 8  # points
BAR = 0.8  # of the distance of bars
TINTS = 12
LEAST_DECADES = 1.0
FEW_DECADES = 2.5  # below, powers of ten alone leave an axis nearly bare


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
    figure = Figure(
        figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * lines), layout="constrained", dpi=DOTS_PER_INCH
    )
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    axes = [figure.add_subplot(lines, columns, k + 1) for k in range(len(bench.panels))]
    for one, panel in zip(axes, bench.panels, strict=True):
        fill(one, panel, bench.of(panel))
    figure.draw_without_rendering()  # labels are placed where the layout has put the axes
    for one, panel in zip(axes, bench.panels, strict=True):
        if panel.label:
            place_labels(one, spots(panel, bench.of(panel)))
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DOTS_PER_INCH)
    Image.open(drawn).convert("RGB").quantize(palette=palette(), dither=Image.Dither.NONE).save(
        small, "png", optimize=True
    )
    return small.getvalue()


def palette() -> Image.Image:
    """Give an image with the colours of a picture: those of series and greys, each mixed with white as smoothed edges are.

    With these alone a file takes a third of the bytes, and nobody sees it.
    """
    pure = np.array([*(hex_rgb(colour) for colour in COLOURS), (128, 128, 128)], float)
    mixed = (pure[:, None] + np.linspace(0, 1, TINTS)[None, :, None] * (255 - pure[:, None])).reshape(-1, 3)
    image = Image.new("P", (1, 1))
    image.putpalette(mixed.round().astype(int).ravel().tolist())
    return image


def hex_rgb(colour: str) -> tuple[int, ...]:
    """Give red, green and blue of `#rrggbb`."""
    return tuple(bytes.fromhex(colour.removeprefix("#")))


def fill(axes: Axes, panel: Panel, rows: list[Row]) -> None:
    """Draw one panel, with its titles, grid and legend."""
    if panel.bars:
        draw_bars(axes, panel, rows)
    else:
        draw_points(axes, panel, rows)
    axes.set_title(panel.title, fontsize=10)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.grid(visible=True, which="major", axis="x" if panel.bars else "both", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    if any(handle.get_label() for handle in axes.get_legend_handles_labels()[0]):
        axes.legend(fontsize=SMALL, framealpha=0.85)


def draw_bars(axes: Axes, panel: Panel, rows: list[Row]) -> None:
    """Draw rows as horizontal bars, the first on top, the series beside one another."""
    every = series(panel, rows)
    names = list(dict.fromkeys(cell(row[key]) for _, key, chosen in every for row in chosen))
    height = BAR / len(every)
    for k, (label, key, chosen) in enumerate(every):
        places = [names.index(cell(row[key])) - BAR / 2 + (k + 0.5) * height for row in chosen]
        axes.barh(
            places, [row[panel.x] for row in chosen], height, color=COLOURS[k % len(COLOURS)], label=label or None
        )
    axes.set_yticks(range(len(names)), names, fontsize=SMALL)
    axes.invert_yaxis()


def draw_points(axes: Axes, panel: Panel, rows: list[Row]) -> None:
    """Draw the points of each series with their quartiles, joined."""
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 (slow to import)

    floors = floors_of(panel, rows)
    for k, (name, key, chosen) in enumerate(series(panel, rows)):
        x, y = along(chosen, panel.x, floors["x"]), along(chosen, key, floors["y"])
        axes.errorbar(
            x, y, xerr=bars(chosen, panel.x, x), yerr=bars(chosen, key, y), label=legend(panel, name, x, y),
            color=COLOURS[k % len(COLOURS)], marker=MARKERS[k % len(MARKERS)], markersize=5, linestyle="-" if panel.joined else "",
            linewidth=1.3, elinewidth=1, capsize=2,
        )  # fmt: skip
    axes.margins(x=0.08, y=0.12)
    if panel.log_x:
        axes.set_xscale("log")
        scale(axes.xaxis, axes.axvline, floors["x"])
    elif all(isinstance(row[panel.x], int) for row in rows):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if panel.log_y:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        wider = max(LEAST_DECADES - np.log10(high / low), 0) / 2  # so that noise does not look like a trend
        axes.set_ylim(low / 10**wider, high * 10**wider)
        scale(axes.yaxis, axes.axhline, floors["y"])


def series(panel: Panel, rows: list[Row]) -> list[tuple[str, str, list[Row]]]:
    """Give name, key of the ordinate, and rows of each series."""
    found = []
    for value in dict.fromkeys(row.get(panel.series or "") for row in rows):
        chosen = [row for row in rows if row.get(panel.series or "") == value]
        for key, named in panel.ordinates.items():
            name = " ".join(text for text in (cell(value), named) if text)
            found.append((name, key, [row for row in chosen if row.get(key) is not None]))
    return found


def spots(panel: Panel, rows: list[Row]) -> list[Spot]:
    """Give the points, with what is written beside them."""
    floors, found = floors_of(panel, rows), []
    assert panel.label is not None
    first = next(iter(panel.ordinates))  # of several ordinates one, so that nothing is written twice
    for k, (_, key, chosen) in enumerate(series(panel, rows)):
        x, y = along(chosen, panel.x, floors["x"]), along(chosen, key, floors["y"])
        reach = bars(chosen, panel.x, x)
        left, right = (x, x) if reach is None else (x - reach[0], x + reach[1])
        texts = [cell(row[panel.label]) if key == first else "" for row in chosen]
        places = zip(x.tolist(), y.tolist(), left.tolist(), right.tolist(), texts, strict=True)
        found += [Spot(*place, COLOURS[k % len(COLOURS)]) for place in places]
    return found


def legend(panel: Panel, name: str, x: Float[np.ndarray, " p"], y: Float[np.ndarray, " p"]) -> str | None:
    """Name a series, with the exponent fitted to its largest sizes where the panel asks for it."""
    if panel.growth and len(np.unique(x[-LARGEST:])) > 1:
        name += f"  ~ size^{fit_growth(list(x[-LARGEST:]), list(y[-LARGEST:]))}"
    return name.strip() or None


def scale(axis: Axis, line: Callable[..., object], zero: float | None) -> None:
    """Give a logarithmic axis ticks that read as numbers, and a dotted line where zeros lie."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415

    low, high = axis.get_view_interval()
    few = np.log10(high / low) < FEW_DECADES
    ticks = list(LogLocator(subs=(1, 2, 5) if few else (1,), numticks=10).tick_values(low, high))
    if zero is not None:
        ticks = [zero, *(tick for tick in ticks if tick > 5 * zero)]
    axis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
    axis.set_minor_formatter(NullFormatter())

    def text(value: float, _: int) -> str:
        if zero is not None and value <= zero * (1 + 1e-6):
            return "0"
        exponent = float(np.floor(np.log10(value) + 1e-9))
        if -2 <= exponent <= 6:
            return f"{value:,.7g}"
        digit = round(value / 10**exponent)
        return f"${'' if digit == 1 else digit}{'' if digit == 1 else chr(92) + 'cdot '}10^{{{exponent:.0f}}}$"

    axis.set_major_formatter(FuncFormatter(text))
    if zero is not None:
        line(zero, color="#999999", linewidth=0.8, linestyle=":")


def floors_of(panel: Panel, rows: list[Row]) -> dict[str, float | None]:
    """Give the places kept for zeros on each logarithmic axis."""
    y = [row[key] for key in panel.ordinates for row in rows if row.get(key) is not None]
    return {
        "x": floor([row[panel.x] for row in rows]) if panel.log_x else None,
        "y": floor(y) if panel.log_y else None,
    }


def floor(values: list[float]) -> float | None:
    """Give a power of ten at least a decade below the smallest value above 0; None where no value is 0."""
    positive = [value for value in values if value > 0]
    if len(positive) == len(values) or not positive:
        return None
    return float(10 ** (np.floor(np.log10(min(positive))) - 1))


def along(rows: list[Row], key: str, lowest: float | None) -> Float[np.ndarray, " p"]:
    """Give the values along an axis, zeros at the place kept for them."""
    values = np.array([row[key] for row in rows], float)
    return values if lowest is None else np.maximum(values, lowest)


def bars(rows: list[Row], key: str, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "2 p"] | None:
    """Give the distances of the quartiles; None where the rows have none."""
    stem = key.removesuffix("_ms")
    quartiles = [[row.get(f"{stem}_q1_ms"), row.get(f"{stem}_q3_ms")] for row in rows]
    if stem == key or any(q is None for pair in quartiles for q in pair):
        return None
    low, high = np.array(quartiles, float).reshape(-1, 2).T
    return np.stack([np.maximum(values - low, 0), np.maximum(high - values, 0)])
