"""Rate and distortion: how good the pictures are with so many bytes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.drawing import SMALL, file_name, new_figure, picture, tidy
from sacha_core.evaluate.report.entry import NOVEL_EXPRESSION, NOVEL_VIEW, SETTINGS, Entry
from sacha_core.evaluate.report.grid import Index
from sacha_core.evaluate.report.look import look_of
from sacha_core.evaluate.report.own import BYTES
from sacha_core.evaluate.report.runs import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SETTING_TITLES", "draw_curves"]

SETTING_TITLES = {NOVEL_VIEW: "novel view", NOVEL_EXPRESSION: "novel expression"}
METRICS = {"psnr": "PSNR, dB", "ssim": "SSIM", "flip": "FLIP (low is good)"}
KILOBYTE = 1000.0
PANEL_HEIGHT_INCHES = 3.0
LEGEND_HEIGHT_INCHES = 0.5
FEW_DECADES = 1.5  # below, powers of ten alone leave an axis nearly bare


def draw_curves(runs: Runs, own: Sequence[Entry]) -> Picture | None:
    """Draw PSNR, SSIM and FLIP over bytes of the Gaussians, both settings; None where nothing was coded."""
    find = Index(own, runs.dataset)
    metrics = [m for m in METRICS if any(e.quantity == m and e.level and e.region is None and e.n_seeds for e in own)]
    if not runs.levels or not metrics:
        return None
    figure = new_figure(PANEL_HEIGHT_INCHES * len(SETTINGS) + LEGEND_HEIGHT_INCHES)
    axes = figure.subplots(len(SETTINGS), len(metrics), squeeze=False, sharex=True)
    for (row, setting), (column, metric) in product(enumerate(SETTINGS), enumerate(metrics)):
        one = axes[row, column]
        for place, variant in enumerate(runs.variants):
            _draw_variant(one, find, runs, variant, place, metric, setting)
        tidy(one, f"{SETTING_TITLES[setting]}: {METRICS[metric]}")
        if row == len(SETTINGS) - 1:
            one.set_xlabel("bytes of the coded Gaussians (KB, logarithmic)", fontsize=SMALL)
    _scale(axes[0, 0])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=-(-len(labels) // -(-len(labels) // 7)),
        frameon=False,
        fontsize=SMALL,
    )
    caption = (
        "Each point is a level of the codec: mean over the seeds, with bars of one standard deviation both ways. Bytes of the Gaussians "
        "after coding, without motion and head. The bars show how much seeds differ; whether two variants differ is told by the paired "
        "tables."
    )
    title = f"{runs.dataset}: quality over bytes"
    return picture(figure, f"curves-{file_name(runs.dataset)}", title, caption)


def _draw_variant(axes: Axes, find: Index, runs: Runs, variant: str, place: int, metric: str, setting: str) -> None:
    points = []
    for level in runs.levels:
        size, quality = find(variant, BYTES, level=level), find(variant, metric, setting=setting, level=level)
        if size is not None and quality is not None and size.n_seeds and quality.n_seeds:
            points.append((size.mean / KILOBYTE, quality.mean, size.sd / KILOBYTE, quality.sd))
    if not points:
        return
    x, y, x_spread, y_spread = np.array(sorted(points)).T
    look = look_of(variant, place)
    axes.errorbar(
        x, y, xerr=np.nan_to_num(x_spread), yerr=np.nan_to_num(y_spread), label=variant, color=look.colour, marker=look.marker,
        linestyle=look.line, linewidth=look.width, elinewidth=0.7, capsize=0, markersize=9 if look.marker == "*" else 5.5,
        markerfacecolor=look.colour if look.filled else "white", zorder=3 if variant == "sacha" else 2,
    )  # fmt: skip


def _scale(axes: Axes) -> None:
    """Make bytes logarithmic, with ticks that read as numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415 (slow to import)

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    few = np.log10(high / low) < FEW_DECADES
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5) if few else (1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
