"""Ears, mouth and eyes close by: the truth, and what variants make of it with about the same bytes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.evaluate.report.content import Picture
from sacha_core.evaluate.report.crops import ASPECT, Crop, closest_levels, find_crops
from sacha_core.evaluate.report.drawing import MEDIUM, PAGE_INCHES, SMALL, file_name, new_figure, picture
from sacha_core.evaluate.report.look import FAINT
from sacha_core.evaluate.report.quantities import size_bytes
from sacha_core.evaluate.report.run_files import RunFiles
from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.subject import Subject
from sacha_core.evaluate.views import evaluation_motion
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.perception.flip import flip_map, missing
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_crops"]

REGIONS = ("ears", "mouth", "eyes")
VARIANTS = ("default", "rad-gp-pis", "sacha")
FLIP_MAP = "magma"  # as FLIP's authors show it
BELOW_CEILING_PERCENT = 98
LOWEST_CEILING = 0.2
KILOBYTE = 1000.0


@dataclass(frozen=True)
class Shown:
    """One variant's picture of one crop.

    Args:
        image: of the crop, in [0, 1].
        flip: of the crop; None where FLIP cannot be measured.
        text: its figures within the region.
    """

    image: Float[np.ndarray, "h w 3"]
    flip: Float[np.ndarray, "h w"] | None
    text: str


def draw_crops(runs: Runs, files: RunFiles) -> Picture | None:
    """Draw the crops of the first seed whose coded avatars are there; None where none are.

    Raises:
        SachaError: a file is damaged.
        OSError: it cannot be read.
    """
    for seed in runs.seeds:
        sizes = coded_sizes(runs, files, seed)
        crops = find_crops(files.subject, REGIONS) if sizes else []
        if crops:
            levels = closest_levels(sizes)
            titles = {v: f"{v}\nlevel {level}, {sizes[v][level] / KILOBYTE:.1f} KB" for v, level in levels.items()}
            avatars = {variant: files.coded(variant, seed, level) for variant, level in levels.items()}
            return _drawn(runs, seed, crops, files.subject, avatars, titles)
    return None


def coded_sizes(runs: Runs, files: RunFiles, seed: int) -> dict[str, dict[int, int]]:
    """Give the bytes of the Gaussians of each variant's coded avatars that are there, by level."""
    wanted = [variant for variant in VARIANTS if variant in runs.variants] or list(runs.variants[: len(VARIANTS)])
    found: dict[str, dict[int, int]] = {}
    for variant in wanted:
        result = runs.of(variant).get(seed)
        for level in runs.levels if result is not None else ():
            size = size_bytes(result, level) if result is not None else None
            if size and files.has_level(variant, seed, level):
                found.setdefault(variant, {})[level] = size
    return found


def shown(avatar: Avatar, crop: Crop, subject: Subject, truth: np.ndarray, rasteriser: Rasteriser) -> Shown:
    """Draw an avatar as a view shows it, and judge it within the crop's region."""
    motion = evaluation_motion(subject.capture, avatar.motion)
    frames = triangle_frames(Poser(subject.head, motion)(crop.view.timestep), subject.head.faces)
    camera = crop.view.camera.resized(subject.width, subject.height)
    drawn = np.clip(render_avatar(avatar.gaussians, frames, camera, rasteriser=rasteriser).colour, 0, 1)
    squared = np.square(drawn.astype(np.float64) - truth / 255)[crop.inside].mean()
    text = f"PSNR {-10 * np.log10(squared):.2f} dB" if squared > 0 else "no error"
    part, errors = (crop.rows, crop.columns), None
    if missing() is None:
        whole = flip_map(drawn, truth)
        text, errors = f"{text}, FLIP {whole[crop.inside].mean():.4f}", whole[part]
    return Shown(drawn[part], errors, text)


def _drawn(
    runs: Runs, seed: int, crops: Sequence[Crop], subject: Subject, avatars: dict[str, Avatar], titles: dict[str, str]
) -> Picture:
    rasteriser, lines = Rasteriser(), 2 if missing() is None else 1
    side = PAGE_INCHES / (len(avatars) + 1)
    figure = new_figure(len(crops) * (lines * side / ASPECT + 0.3) + 0.4)
    axes = figure.subplots(lines * len(crops), len(avatars) + 1, squeeze=False)
    truths = [subject.capture.image(crop.view, subject.width, subject.height) for crop in crops]
    drawn = [
        [shown(a, crop, subject, truth, rasteriser) for a in avatars.values()]
        for crop, truth in zip(crops, truths, strict=True)
    ]
    ceiling = _ceiling([one.flip for line in drawn for one in line if one.flip is not None])
    for row, (crop, truth, line) in enumerate(zip(crops, truths, drawn, strict=True)):
        above, below = axes[lines * row], axes[lines * row + lines - 1]
        where = f"{crop.region}: camera {crop.view.camera_index}, moment {crop.view.timestep}"
        _show(above[0], truth[crop.rows, crop.columns], where)
        if lines > 1:
            below[0].set_axis_off()
            text = f"FLIP's error:\nblack 0, pale {ceiling:.1f}\nand more"
            below[0].text(0.98, 0.5, text, ha="right", va="center", color=FAINT, transform=below[0].transAxes)
        for column, one in enumerate(line, 1):
            _show(above[column], one.image, one.text)
            if one.flip is not None:
                _show(below[column], one.flip, "", ceiling)
    for one, title in zip(axes[0], ("truth\nheld-out expression", *titles.values()), strict=True):
        one.set_title(title, fontsize=MEDIUM)
    caption = (
        f"Seed {seed}, at the levels whose bytes are closest to one another. Figures below a picture are of the region's pixels alone. The "
        "views are those of the held-out sequence that show most of the region, whatever the variants make of them."
    )
    return picture(figure, f"crops-{file_name(runs.dataset)}", f"{runs.dataset}: close by", caption, lines=False)


def _ceiling(maps: Sequence[Float[np.ndarray, "_ _"]]) -> float:
    """Give the error at which the colours of all maps end: a tenth, and nearly all errors are below it."""
    highest = max((float(np.percentile(one, BELOW_CEILING_PERCENT)) for one in maps), default=0.0)
    return min(max(math.ceil(10 * highest) / 10, LOWEST_CEILING), 1.0)


def _show(axes: Axes, image: np.ndarray, text: str, ceiling: float = 1.0) -> None:
    if image.ndim == 2:
        axes.imshow(image, cmap=FLIP_MAP, vmin=0, vmax=ceiling, interpolation="lanczos")
    else:
        axes.imshow(image, interpolation="lanczos")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    axes.set_xlabel(text, fontsize=SMALL, labelpad=3)
