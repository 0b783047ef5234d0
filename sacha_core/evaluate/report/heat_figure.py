"""Heat maps on the head: how densely each variant's Gaussians lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from sacha_core.evaluate.report.allocation_figure import shown_variants
from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.drawing import MEDIUM, PAGE_INCHES, SMALL, file_name, new_figure, picture
from sacha_core.evaluate.report.look import FAINT
from sacha_core.evaluate.report.run_files import RunFiles
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.surface_density import portrait_camera, smooth_density, triangle_picture
from sacha_core.flame.posing import person_template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_heat_maps"]

RADIUS_M = 0.008
DIRECTIONS = {"front": (0.0, 0.0, 1.0), "side": (1.0, 0.0, 0.35)}
PORTRAIT = (300, 390)  # pixels, width and height
DENSITY_MAP, RATIO_MAP = "cividis", "PuOr_r"  # the same to colour-blind eyes
EXTREMES = (2, 98)  # percentiles of the densities that the scale spans
MOST_RATIO = 8.0
ROW_INCHES = 2.15


def draw_heat_maps(runs: Runs, files: RunFiles, baseline: str) -> Picture | None:
    """Draw each variant's density on the neutral head, from the front and the side, and against the baseline's.

    Means over the seeds whose models are there; None where no variant's are.

    Raises:
        SachaError: a model is damaged.
        OSError: it cannot be read.
    """
    from matplotlib import colormaps  # noqa: PLC0415 (slow to import)
    from matplotlib.colors import LogNorm  # noqa: PLC0415

    counts = mean_counts(runs, files)
    if not counts:
        return None
    subject = files.subject
    vertices, _ = person_template(subject.head, subject.capture.motion)
    faces = subject.head.faces
    density = dict(zip(counts, smooth_density(vertices, faces, np.stack(list(counts.values())), RADIUS_M), strict=True))
    low, high = np.percentile(np.concatenate([d[d > 0] for d in density.values()]), EXTREMES)
    scale, ratios = LogNorm(low, max(high, 1.01 * low)), LogNorm(1 / MOST_RATIO, MOST_RATIO)
    rows: list[tuple[str, dict[str, Float[np.ndarray, "h w 3"]]]] = []
    for name, direction in DIRECTIONS.items():
        camera = portrait_camera(vertices, direction, *PORTRAIT)
        pictures = {
            variant: triangle_picture(vertices, faces, colormaps[DENSITY_MAP](scale(np.maximum(d, low)))[:, :3], camera)
            for variant, d in density.items()
        }
        rows.append((name, pictures))
    if baseline in density and len(density) > 1:
        camera = portrait_camera(vertices, DIRECTIONS["front"], *PORTRAIT)
        least = low / MOST_RATIO
        pictures = {
            variant: triangle_picture(
                vertices,
                faces,
                colormaps[RATIO_MAP](ratios(np.maximum(d, least) / np.maximum(density[baseline], least)))[:, :3],
                camera,
            )
            for variant, d in density.items()
            if variant != baseline
        }
        rows.append((f"over {baseline}", pictures))
    figure = _laid_out(list(counts), rows, scale, ratios, baseline)
    caption = (
        "Gaussians per square centimetre of the neutral head, hidden ones counted, averaged over 8 mm around each triangle and over the "
        f"seeds. One scale for all variants. Last row: density over {baseline}'s; orange is denser, purple is sparser. Darker edges are "
        "shading."
    )
    title = f"{runs.dataset}: Gaussians on the head"
    return picture(figure, f"heat-{file_name(runs.dataset)}", title, caption, lines=False)


def mean_counts(runs: Runs, files: RunFiles) -> dict[str, Float[np.ndarray, " f"]]:
    """Give the Gaussians of each triangle, the mean over the seeds, of the variants whose models are there."""
    found = {}
    for variant in shown_variants(runs):
        known = [counts for seed in runs.of(variant) if (counts := files.counts(variant, seed)) is not None]
        if known:
            found[variant] = np.mean(known, axis=0)
    return found


def _laid_out(
    variants: list[str], rows: list[tuple[str, dict[str, Any]]], scale: Any, ratios: Any, baseline: str
) -> Figure:
    """Put rows of portraits below one another, each with its scale to the right."""
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415 (slow to import)

    n = len(variants)
    side = min(PAGE_INCHES / (n + 0.6), ROW_INCHES)
    figure = new_figure(len(rows) * side * PORTRAIT[1] / PORTRAIT[0] + 0.3, (n + 0.6) * side)
    axes = figure.subplots(len(rows), n, squeeze=False)
    for line, (name, pictures) in zip(axes, rows, strict=True):
        for one, variant in zip(line, variants, strict=True):
            one.set_axis_off()
            if variant in pictures:
                one.imshow(pictures[variant], interpolation="lanczos")
            else:
                one.text(0.5, 0.5, "1 by\ndefinition", ha="center", va="center", color=FAINT, transform=one.transAxes)
        line[0].text(0, 1, name, ha="left", va="top", transform=line[0].transAxes, fontsize=SMALL, color=FAINT)
        over = name.startswith("over ")
        mapped = ScalarMappable(ratios if over else scale, RATIO_MAP if over else DENSITY_MAP)
        bar = figure.colorbar(mapped, ax=line, fraction=0.02, pad=0.01, aspect=18)
        bar.set_label(f"density over {baseline}'s" if over else "Gaussians per cm²", fontsize=SMALL)
        _plain_ticks(bar, over)
    for one, variant in zip(axes[0], variants, strict=True):
        one.set_title(variant, fontsize=MEDIUM)
    return figure


def _plain_ticks(bar: Any, over: bool) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator  # noqa: PLC0415

    bar.ax.yaxis.set_major_locator(
        FixedLocator([1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8]) if over else LogLocator(subs=(1, 2, 5))
    )
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    bar.ax.tick_params(labelsize=SMALL)
