"""What each step is worth: paired differences, seed by seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sacha_core.evaluate.report.comparisons import BYTE_TARGETS, STEPS, Step
from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.curve_figure import SETTING_TITLES
from sacha_core.evaluate.report.drawing import SMALL, file_name, new_figure, picture, tidy
from sacha_core.evaluate.report.entry import SETTINGS, Entry
from sacha_core.evaluate.report.grid import Index
from sacha_core.evaluate.report.look import FAINT, INK, look_of
from sacha_core.evaluate.report.rates import BD_RATE
from sacha_core.evaluate.report.runs import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_steps"]

ROW_INCHES, FRAME_INCHES = 0.34, 1.2
METRICS = {"psnr": "PSNR", "flip": "FLIP"}
ABOVE, BELOW = 0.16, -0.16  # of a row's height: the two settings


def draw_steps(runs: Runs, rates: Sequence[Entry]) -> Picture | None:
    """Draw the BD-rate of each step, a dot a seed and the mean with its spread; None where no step has both of its variants."""
    steps = [step for step in STEPS if {step.variant, step.against} <= set(runs.variants)]
    if not steps or not runs.levels:
        return None
    find = Index(rates, runs.dataset)
    figure = new_figure(ROW_INCHES * len(steps) + FRAME_INCHES)
    axes = figure.subplots(1, len(METRICS), sharey=True)
    for one, (metric, title) in zip(axes, METRICS.items(), strict=True):
        for row, step in enumerate(steps):
            for place, setting in zip((BELOW, ABOVE), SETTINGS, strict=True):
                entry = find(step.variant, f"{BD_RATE} ({metric})", against=step.against, setting=setting)
                _draw_step(one, row + place, entry, step, hollow=setting == SETTINGS[1])
            if metric == "psnr":
                _draw_target(one, row, step)
        one.axvline(0, color=FAINT, linewidth=1)
        one.set_xlabel("\N{LEFTWARDS ARROW} the first of the pair needs fewer", fontsize=SMALL)
        tidy(one, f"bytes at equal {title}, percent", "x")
    axes[0].set_yticks(range(len(steps)), [f"{step.variant} against {step.against}" for step in steps])
    axes[0].set_ylim(len(steps) - 0.5, -0.5)
    caption = (
        f"BD-rate over {' and '.join(METRICS.values())} of pairs with the same seed: a small dot a seed, a large one with a bar for mean "
        f"and standard deviation. Filled: {SETTING_TITLES[SETTINGS[0]]}; hollow: {SETTING_TITLES[SETTINGS[1]]}. A bar across a row marks a "
        "target. A pair whose curves have no quality in common has no dots."
    )
    return picture(figure, f"steps-{file_name(runs.dataset)}", f"{runs.dataset}: what each step is worth", caption)


def _draw_step(axes: Axes, y: float, entry: Entry | None, step: Step, hollow: bool) -> None:
    if entry is None or not entry.n_seeds:
        return
    colour = look_of(step.variant).colour
    face = "white" if hollow else colour
    axes.plot(entry.values, [y] * entry.n_seeds, linestyle="", marker="o", markersize=3, color=colour, alpha=0.55)
    spread = 0.0 if entry.n_seeds < 2 else entry.sd
    axes.errorbar(
        [entry.mean],
        [y],
        xerr=[spread],
        color=colour,
        marker="o",
        markersize=6.5,
        markerfacecolor=face,
        elinewidth=1.2,
        capsize=0,
    )


def _draw_target(axes: Axes, row: int, step: Step) -> None:
    for target in BYTE_TARGETS:
        if (target.variant, target.against) == (step.variant, step.against):
            axes.plot(
                [-target.fewer_percent] * 2, [row - 0.4, row + 0.4], color=INK, linewidth=1.8, solid_capstyle="butt"
            )
