"""Pictures: what is drawn where, and that labels keep out of each other's way."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from sacha_core.bench.labels import Spot, place_labels
from sacha_core.bench.plot import COLOURS, draw, fill, hex_rgb
from sacha_core.bench.result import Bench, Panel

LARGEST_FILE = 100_000  # bytes, of which a page holds several


def rows(n: int) -> list[dict[str, object]]:
    return [
        {"table": "t", "n": 10**k, "a_ms": 2.0 * 10**k, "a_q1_ms": 1.5 * 10**k, "a_q3_ms": 4.0 * 10**k,
         "error": 0.0 if k == 1 else 10.0**-k, "kind": "even" if k % 2 == 0 else "odd", "name": f"row {k}"}
        for k in range(1, n + 1)
    ]  # fmt: skip


def axes_of(panel: Panel, found: list[dict[str, object]]):
    axes = Figure().add_subplot()
    fill(axes, panel, found)
    return axes


def test_points_are_the_rows_and_bars_their_quartiles() -> None:
    axes = axes_of(Panel("p", "t", "n", "a_ms", "n", "ms"), rows(3))
    line = axes.containers[0].lines[0]
    assert line.get_xydata().tolist() == [[10.0, 20.0], [100.0, 200.0], [1000.0, 2000.0]]
    ends = np.array(axes.containers[0].lines[2][0].get_segments())[:, :, 1]
    assert ends == pytest.approx(np.array([[15.0, 40.0], [150.0, 400.0], [1500.0, 4000.0]]))


def test_every_value_of_the_series_gets_a_colour_and_a_name() -> None:
    axes = axes_of(Panel("p", "t", "n", "a_ms", "n", "ms", series="kind"), rows(4))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["odd", "even"]
    assert [container.lines[0].get_color() for container in axes.containers] == list(COLOURS[:2])


def test_the_legend_tells_the_exponent() -> None:
    axes = axes_of(Panel("p", "t", "n", {"a_ms": "a"}, "n", "ms", growth=True), rows(4))
    assert axes.get_legend().get_texts()[0].get_text().startswith("a  ~ size^1.00")


def test_zeros_lie_on_a_line_of_their_own_on_a_logarithmic_axis() -> None:
    axes = axes_of(Panel("p", "t", "n", "error", "n", "error"), rows(4))
    zero, *others = axes.containers[0].lines[0].get_ydata()
    assert 0 < zero <= min(others) / 10
    formatter = axes.yaxis.get_major_formatter()
    assert formatter(axes.yaxis.get_majorticklocs()[0], 0) == "0"


def test_rows_without_a_figure_are_left_out() -> None:
    found = [*rows(2), {"table": "t", "n": 5}, {"table": "other", "n": 6, "a_ms": 1.0}]
    bench = Bench(found, (), (Panel("p", "t", "n", "a_ms", "n", "ms"),))
    assert bench.of(bench.panels[0]) == rows(2)


def test_labels_overlap_neither_each_other_nor_points_and_stay_inside() -> None:
    figure = Figure(figsize=(5, 4))
    axes = figure.add_subplot()
    rng = np.random.default_rng(0)
    places = [(0.5 + 0.02 * rng.normal(), 0.5 + 0.02 * rng.normal()) for _ in range(6)]
    axes.plot(*zip(*places, strict=True), "o")
    axes.set(xlim=(0, 1), ylim=(0, 1))
    figure.draw_without_rendering()
    place_labels(
        axes, [Spot(x, y, x - 0.05, x + 0.05, f"a label of point {k}", "black") for k, (x, y) in enumerate(places)]
    )
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    room = axes.get_window_extent()
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
        assert room.x0 <= box.x0
        assert box.x1 <= room.x1
        assert not any(box.contains(*axes.transData.transform(place)) for place in places)


def test_a_picture_is_a_small_png_with_the_series_colours() -> None:
    panels = (
        Panel("one", "t", "n", "a_ms", "n", "ms", series="kind"),
        Panel("two", "t", "a_ms", "error", "ms", "error", label="name", joined=False),
        Panel("three", "t", "n", {"a_ms": "a", "error": "error"}, "n", "ms", log_x=False, log_y=False),
    )
    png = draw(Bench(rows(5), (), panels), "A title")
    image = Image.open(io.BytesIO(png))
    assert image.format == "PNG"
    assert len(png) < LARGEST_FILE
    pixels = {tuple(pixel) for pixel in np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()}
    assert {hex_rgb(colour) for colour in COLOURS[:2]} <= pixels
