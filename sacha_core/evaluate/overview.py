"""The picture of a comparison: truth, variants, the decoded levels, and where each region's Gaussians went."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace

import matplotlib as mpl
import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec import decode
from sacha_core.evaluate.comparison import LEVELS, LevelResult, Quality, VariantResult
from sacha_core.evaluate.sheet import Panel, write_sheet
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser
from sacha_core.geometry.triangle import triangle_frames
from sacha_core.interchange.capture import Capture, View
from sacha_core.perception.psnr import psnr
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.raster.scene import render_avatar
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER

__all__ = ["Overview"]

HEAT_MAP = "cividis"  # the same to colour-blind eyes, and its lightness grows steadily
MARGIN = 12  # white pixels left around the head


@dataclass(frozen=True)
class Overview:
    """What the picture shows.

    Args:
        capture: what the variants were trained on.
        head: the head that they are bound to.
        baseline: name of the variant that the other is measured by.
        ours: name of the variant whose levels are shown.
        avatars: both variants, uncompressed, by name.
        results: their figures, by name.
    """

    capture: Capture
    head: HeadModel
    baseline: str
    ours: str
    avatars: Mapping[str, Avatar]
    results: Mapping[str, VariantResult]

    def write(self, path: str | os.PathLike[str]) -> None:
        """Draw one row for the held-out camera and one for a held-out expression, and write them as PNG.

        Raises:
            OSError: the file cannot be written.
        """
        decoded = {
            level: decode(self.results[self.ours].levels[level].file, head=self.head) for level in reversed(LEVELS)
        }
        rows = [
            self._row("held-out camera", middle_view(self.capture.val), decoded, explained=False),
            self._row(
                "held-out expression", middle_view(self.capture.test, from_the_side=True), decoded, explained=True
            ),
        ]
        write_sheet(path, [cropped(row) for row in rows])

    def _row(self, what: str, view: View, decoded: Mapping[int, Avatar], explained: bool) -> list[Panel]:
        rasteriser = Rasteriser()
        truth = self.capture.image(view)
        split = "novel_view" if view in self.capture.val else "novel_expression"

        def panel(avatar: Avatar, title: str, size: str, result: VariantResult | LevelResult) -> Panel:
            drawn = self._draw(avatar, view, rasteriser)
            mean: Quality = getattr(result, split)
            return Panel(drawn, title, (size, f"{psnr(drawn, truth):.2f} dB here", f"{mean.psnr:.2f} dB on average"))

        seen = (what, f"camera {view.camera_index}", f"timestep {view.timestep}")
        panels = [Panel(truth.astype(np.float32) / 255, "truth", seen)]
        for name in (self.baseline, self.ours):
            result = self.results[name]
            size = f"{result.n_gaussians:,}, {result.raw_bytes / 1e6:.2f} MB"
            panels.append(panel(self.avatars[name], name, size, result))
        for level, avatar in decoded.items():
            coded = self.results[self.ours].levels[level]
            panels.append(panel(avatar, f"{self.ours}, level {level}", f"{coded.n_bytes / 1000:.1f} KB", coded))
        return [*panels, self._heat_map(view, rasteriser, explained)]

    def _draw(
        self, avatar: Avatar, view: View, rasteriser: Rasteriser, colours: Float[np.ndarray, "n 3"] | None = None
    ) -> Float[np.ndarray, "h w 3"]:
        assert avatar.motion is not None
        vertices = Poser(self.head, avatar.motion)(view.timestep)
        frames = triangle_frames(vertices, self.head.faces)
        return render_avatar(avatar.gaussians, frames, view.camera, colours=colours, rasteriser=rasteriser).colour

    def _heat_map(self, view: View, rasteriser: Rasteriser, explained: bool) -> Panel:
        """Draw our avatar with each region in the colour of its visible Gaussians' number over the baseline's."""
        ours, theirs = self.results[self.ours].visible_per_region, self.results[self.baseline].visible_per_region
        shares = np.array([ours[region] / max(theirs[region], 1) for region in PAPER.regions])
        palette = heat_colours(shares)
        avatar = self.avatars[self.ours]
        drawn = self._draw(avatar, view, rasteriser, palette[label_triangles(self.head)[avatar.gaussians.binding]])
        legend = tuple(
            ((float(red), float(green), float(blue)), f"{region} {ours[region]:,} of {theirs[region]:,}")
            for region, (red, green, blue) in zip(PAPER.regions, palette, strict=True)
        )
        caption = ("Gaussians that show,", f"{self.ours} of {self.baseline}") if explained else ()
        return Panel(drawn, "by region", caption, legend if explained else ())


def middle_view(views: tuple[View, ...], from_the_side: bool = False) -> View:
    """Give the view in the middle of time, by the middle one of the cameras that saw it or by one towards the side."""
    ordered = sorted(views, key=lambda view: (view.timestep, view.camera_index))
    timestep = ordered[len(ordered) // 2].timestep
    there = [view for view in ordered if view.timestep == timestep]
    return there[len(there) // (4 if from_the_side else 2)]


def heat_colours(shares: Float[np.ndarray, " r"]) -> Float[np.ndarray, "r 3"]:
    """Give the colour of each share, float32 sRGB in [0, 1]; the smallest is the darkest, the largest the lightest."""
    place = (shares - shares.min()) / max(float(np.ptp(shares)), 1e-9)
    colours: np.ndarray = mpl.colormaps[HEAT_MAP](place)[:, :3].astype(np.float32)
    return colours


def cropped(row: list[Panel]) -> list[Panel]:
    """Cut the white around the first panel's head off all panels of a row."""
    inked: np.ndarray = np.any(row[0].image < 1, axis=2)
    if not inked.any():
        return row
    ys, xs = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    top, left = max(int(ys[0]) - MARGIN, 0), max(int(xs[0]) - MARGIN, 0)
    return [replace(panel, image=panel.image[top : int(ys[-1]) + MARGIN, left : int(xs[-1]) + MARGIN]) for panel in row]
