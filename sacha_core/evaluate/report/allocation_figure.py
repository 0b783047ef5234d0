"""Where the Gaussians went, region by region, and what sent them there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.drawing import SMALL, file_name, new_figure, picture, tidy
from sacha_core.evaluate.report.entry import Entry
from sacha_core.evaluate.report.grid import Index
from sacha_core.evaluate.report.look import FAINT, INK, look_of
from sacha_core.evaluate.report.runs import Runs
from sacha_core.regions.scheme import PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_allocation", "shown_variants"]

SHOWN = ("default", "default-seen", "rad", "rad-gp-pis", "paper", "sacha")
MOST = 7  # bars a group that can still be told apart
GROUP = 0.84  # of the distance between regions
PALE = 0.35
COUNTS_TITLE = "Gaussians: visible (full colour), hidden (pale), before pruning began (tick)"
MODULATORS_TITLE = "modulator $m_R$: at the first calibration (hollow) and at the last (filled)"


def shown_variants(runs: Runs) -> tuple[str, ...]:
    """Give the variants that figures with one element a variant show: all where they are few, else the main ones."""
    if len(runs.variants) <= MOST:
        return runs.variants
    return tuple(variant for variant in runs.variants if variant in SHOWN) or runs.variants[:MOST]


def draw_allocation(runs: Runs, own: Sequence[Entry]) -> Picture:
    """Draw counts by region, before and after pruning, and modulators at the first and the last calibration."""
    find, variants = Index(own, runs.dataset), shown_variants(runs)
    figure = new_figure(6.6)
    counts, modulators = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    width = GROUP / len(variants)
    for place, variant in enumerate(variants):
        x = np.arange(len(PAPER.regions)) - GROUP / 2 + (place + 0.5) * width
        _draw_counts(counts, find, variant, place, x, width)
        _draw_modulators(modulators, find, variant, place, x)
    counts.set_title(
        "Gaussians by region: visible (full colour), hidden (pale), before pruning began (tick)", loc="left"
    )
    counts.set_ylabel("Gaussians")
    modulators.set_ylabel("\N{LEFTWARDS ARROW} more Gaussians", fontsize=SMALL)
    modulators.axhline(1, color=FAINT, linewidth=1)
    modulators.set_xticks(range(len(PAPER.regions)), PAPER.regions)
    for axes, title in ((counts, COUNTS_TITLE), (modulators, MODULATORS_TITLE)):
        tidy(axes, title, "y")
        axes.tick_params(axis="x", length=0, labelsize=SMALL + 1, labelbottom=True)
    handles, labels = counts.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=SMALL)
    left_out = [variant for variant in runs.variants if variant not in variants]
    caption = (
        "Means over the seeds, thin bars: one standard deviation. Variants without calibration have no modulators."
        + (f" Not drawn, but in the tables: {', '.join(left_out)}." if left_out else "")
    )
    return picture(
        figure, f"allocation-{file_name(runs.dataset)}", f"{runs.dataset}: where the Gaussians went", caption
    )


def _draw_counts(axes: Axes, find: Index, variant: str, place: int, x: np.ndarray, width: float) -> None:
    colour = look_of(variant, place).colour
    total, spread = _by_region(find, variant, "Gaussians")
    visible, _ = _by_region(find, variant, "visible Gaussians")
    before, _ = _by_region(find, variant, "Gaussians before pruning")
    axes.bar(x, np.nan_to_num(visible), 0.9 * width, color=colour, label=variant)
    hidden = np.nan_to_num(total - visible)
    axes.bar(x, hidden, 0.9 * width, bottom=np.nan_to_num(visible), color=colour, alpha=PALE, linewidth=0)
    axes.errorbar(x, total, yerr=np.nan_to_num(spread), linestyle="", color=INK, elinewidth=0.7)
    axes.hlines(before, x - 0.45 * width, x + 0.45 * width, color=INK, linewidth=1.4)


def _draw_modulators(axes: Axes, find: Index, variant: str, place: int, x: np.ndarray) -> None:
    look = look_of(variant, place)
    first, _ = _by_region(find, variant, "first modulator")
    last, spread = _by_region(find, variant, "last modulator")
    size = 9 if look.marker == "*" else 5.5
    axes.vlines(x, first, last, color=look.colour, linewidth=1)
    axes.plot(x, first, linestyle="", marker=look.marker, markersize=size, color=look.colour, markerfacecolor="white")
    axes.errorbar(
        x,
        last,
        yerr=np.nan_to_num(spread),
        linestyle="",
        marker=look.marker,
        markersize=size,
        color=look.colour,
        elinewidth=0.7,
    )


def _by_region(find: Index, variant: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Give mean and standard deviation in each region; not a number where there is none."""
    entries = [find(variant, quantity, region=region) for region in PAPER.regions]
    pairs = [(np.nan, np.nan) if entry is None else (entry.mean, entry.sd) for entry in entries]
    mean, sd = np.array(pairs, float).T
    return mean, sd
