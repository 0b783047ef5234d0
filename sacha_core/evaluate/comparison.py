"""Judging trained variants beside one another: Gaussians spent, bytes, and what is left of the picture at each level."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import PLY_BYTES_PER_GAUSSIAN, Gaussians
from sacha_core.codec import decode, inspect
from sacha_core.evaluate.views import evaluate_avatar, evaluation_motion
from sacha_core.evaluate.visibility import visible_gaussians
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.capture import Capture
from sacha_core.progress import Progress, Report, silent
from sacha_core.raster.rasteriser import Rasteriser
from sacha_core.rate.encoding import RenderingEncoder
from sacha_core.regions.labels import label_triangles, region_counts
from sacha_core.regions.scheme import PAPER

__all__ = ["LEVELS", "Judge", "LevelResult", "Quality", "VariantResult"]

LEVELS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Quality:
    """Mean figures over held-out images.

    Args:
        psnr: decibels.
        ssim: structural similarity.
    """

    psnr: float
    ssim: float

    def to_json(self) -> dict[str, float]:
        """Give plain values."""
        return {"psnr": round(self.psnr, 3), "ssim": round(self.ssim, 5)}


@dataclass(frozen=True)
class LevelResult:
    """One variant at one level of the codec.

    Args:
        file: the `.sacha` file.
        n_bytes: Gaussians and motion, without the head.
        bytes_per_frame: of motion.
        novel_view: decoded Gaussians and motion, by the held-out camera.
        novel_expression: decoded Gaussians and motion, at held-out timesteps.
    """

    file: Path
    n_bytes: int
    bytes_per_frame: float
    novel_view: Quality
    novel_expression: Quality

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {
            "file": str(self.file),
            "bytes": self.n_bytes,
            "bytes_per_frame": round(self.bytes_per_frame, 2),
            "novel_view": self.novel_view.to_json(),
            "novel_expression": self.novel_expression.to_json(),
        }


@dataclass(frozen=True)
class VariantResult:
    """One trained variant.

    Args:
        n_gaussians: how many it has.
        n_visible: how many ever show in training views.
        per_region: Gaussians by region name.
        visible_per_region: those that ever show in training views, by region name.
        novel_view: uncompressed, by the held-out camera.
        novel_expression: uncompressed, at held-out timesteps.
        levels: by level.
    """

    n_gaussians: int
    n_visible: int
    per_region: Mapping[str, int]
    visible_per_region: Mapping[str, int]
    novel_view: Quality
    novel_expression: Quality
    levels: Mapping[int, LevelResult]

    @property
    def raw_bytes(self) -> int:
        """Size as GaussianAvatars stores it: 252 bytes a Gaussian."""
        return PLY_BYTES_PER_GAUSSIAN * self.n_gaussians

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {
            "n_gaussians": self.n_gaussians,
            "n_visible": self.n_visible,
            "per_region": dict(self.per_region),
            "visible_per_region": dict(self.visible_per_region),
            "raw_bytes": self.raw_bytes,
            "novel_view": self.novel_view.to_json(),
            "novel_expression": self.novel_expression.to_json(),
            "levels": {str(level): result.to_json() for level, result in self.levels.items()},
        }


class Judge:
    """Measures variants on one capture, all in the same way.

    Each moves by its own motion (see `evaluation_motion`); a compressed variant is drawn with what its file gives back.

    Args:
        capture: what the variants were trained on; judged at its stored resolution.
        head: the head that they are bound to.
        report: told after each image.
    """

    def __init__(self, capture: Capture, head: HeadModel, report: Report = silent) -> None:
        self._capture = capture
        self._head = head
        self._labels = label_triangles(head)
        self._report = report
        self._rasteriser = Rasteriser()

    def variant(self, name: str, avatar: Avatar, folder: Path) -> VariantResult:
        """Judge one variant, uncompressed and at every level; its files `NAME-LEVEL.sacha` are left in `folder`.

        Args:
            name: what progress and files call it.
            avatar: Gaussians, and a motion whose frame t is timestep t of the capture.
            folder: where the `.sacha` files go.

        Raises:
            SachaError: the avatar is not of this capture or head.
            OSError: a file cannot be written.
        """
        gaussians, motion = avatar.gaussians, evaluation_motion(self._capture, avatar.motion)
        first = self._capture.train[0].camera
        visible = visible_gaussians(
            gaussians, self._head, motion, self._capture.train, first.width, first.height, self._rasteriser
        )
        view, expression = self._quality(name, avatar)
        encoder = RenderingEncoder(avatar, self._head)
        levels = {level: self._level(name, encoder, level, folder) for level in LEVELS}
        counts = (self._by_region(gaussians), self._by_region(gaussians.select(visible)))
        return VariantResult(len(gaussians), int(np.count_nonzero(visible)), *counts, view, expression, levels)

    def _by_region(self, gaussians: Gaussians) -> dict[str, int]:
        counts = region_counts(self._labels, gaussians.binding)
        return {region: int(count) for region, count in zip(PAPER.regions, counts, strict=True)}

    def _level(self, name: str, encoder: RenderingEncoder, level: int, folder: Path) -> LevelResult:
        file = folder / f"{name}-{level}.sacha"
        with write_aside(file) as aside:
            aside.write_bytes(encoder.encode(level).data)
        sizes = inspect(file)
        view, expression = self._quality(f"{name}, level {level}", decode(file, head=self._head))
        n_bytes = sizes.total_bytes - sizes.head_bytes
        return LevelResult(file, n_bytes, sizes.dynamic_bytes_per_frame, view, expression)

    def _quality(self, stage: str, avatar: Avatar) -> tuple[Quality, Quality]:
        """Measure the held-out camera, then the held-out timesteps."""

        def report(progress: Progress) -> None:
            self._report(replace(progress, stage=f"judge {stage}, {progress.stage}"))

        found = evaluate_avatar(
            avatar.gaussians, self._head, self._capture, avatar.motion, report=report, rasteriser=self._rasteriser
        )
        view, expression = found.novel_view, found.novel_expression
        return Quality(view.psnr, view.ssim), Quality(expression.psnr, expression.ssim)
