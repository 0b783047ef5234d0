"""How close drawn images come to captured ones: image by image, over all of them, and within each region of the head."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.errors import OptionError
from sacha_core.evaluate.lpips import NETWORKS, LpipsNetwork, open_network
from sacha_core.interchange.capture import View
from sacha_core.perception.flip import flip_map
from sacha_core.perception.flip import missing as flip_lacks
from sacha_core.perception.psnr import psnr, unit_range
from sacha_core.perception.ssim import ssim
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER, RegionScheme

__all__ = [
    "DEFAULT_METRICS",
    "METRICS",
    "ImageScore",
    "PictureMetrics",
    "Quality",
    "RegionQuality",
    "ViewScores",
    "require_metrics",
]

METRICS = ("psnr", "ssim", "flip", "lpips")
DEFAULT_METRICS = ("psnr", "ssim")  # what needs no package beyond the core's


@dataclass(frozen=True)
class RegionQuality:
    """How close the picture comes to the truth within one region of the head.

    Args:
        psnr: decibels, of the squared error pooled over all of the region's pixels; None where no image shows it, or nothing differs.
        flip: mean FLIP error, 0 to 1, over the same pixels; None where it shows nowhere or was not measured.
        pixels: how many were looked at.
    """

    psnr: float | None
    flip: float | None
    pixels: int


@dataclass(frozen=True)
class Quality:
    """Mean figures over held-out images.

    Args:
        n_images: how many were looked at.
        psnr: decibels, mean of the images'.
        ssim: structural similarity.
        flip: FLIP error, 0 to 1, the lower the better; None where it was not measured.
        lpips_vgg: LPIPS with VGG's features; None where it was not measured.
        lpips_alex: with AlexNet's.
        regions: by region name; none where regions were not looked at.
    """

    n_images: int
    psnr: float
    ssim: float
    flip: float | None
    lpips_vgg: float | None
    lpips_alex: float | None
    regions: Mapping[str, RegionQuality]


@dataclass(frozen=True)
class ImageScore:
    """How close one drawn image comes to the captured one.

    Args:
        timestep: of the capture.
        camera_index: which camera.
        psnr: decibels, over all pixels.
        ssim: structural similarity; NaN where it was not asked for.
        flip: mean FLIP error; None where it was not measured.
        lpips_vgg: LPIPS with VGG's features; None where it was not measured.
        lpips_alex: with AlexNet's.
    """

    timestep: int
    camera_index: int
    psnr: float
    ssim: float
    flip: float | None = None
    lpips_vgg: float | None = None
    lpips_alex: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Give what was measured."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class ViewScores:
    """Scores of several images.

    Args:
        images: one score each.
        regions: by region name; none where regions were not looked at.
    """

    images: tuple[ImageScore, ...]
    regions: Mapping[str, RegionQuality]

    @property
    def psnr(self) -> float:
        """Mean over the images of each one's PSNR, decibels."""
        return float(np.mean([image.psnr for image in self.images]))

    @property
    def ssim(self) -> float:
        """Mean structural similarity."""
        return float(np.mean([image.ssim for image in self.images]))

    @property
    def quality(self) -> Quality:
        """The means, and every region's figures."""
        flip, vgg, alex = (
            mean_of([getattr(image, name) for image in self.images]) for name in ("flip", "lpips_vgg", "lpips_alex")
        )
        return Quality(len(self.images), self.psnr, self.ssim, flip, vgg, alex, self.regions)

    def to_json(self) -> dict[str, Any]:
        """Give the means and every image's figures."""
        quality = {name: value for name, value in vars(self.quality).items() if value is not None}
        del quality["n_images"]
        regions = {name: vars(region) for name, region in self.regions.items()}
        return quality | {"regions": regions, "images": [image.to_json() for image in self.images]}


def mean_of(values: Sequence[float | None]) -> float | None:
    """Give the mean, or None where a value is missing."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found and len(found) == len(values) else None


def require_metrics(metrics: Collection[str]) -> None:
    """Check that metrics can be measured, before hours go by.

    Raises:
        OptionError: there is no such metric, or FLIP's package is missing.
    """
    unknown = sorted(set(metrics) - set(METRICS))
    if unknown:
        raise OptionError(f"no metric {unknown[0]!r}; there are {', '.join(METRICS)}")
    lacking = flip_lacks() if "flip" in metrics else None
    if lacking:
        raise OptionError(lacking)


class PictureMetrics:
    """Compares images one after the other, and sums up by region.

    Args:
        metrics: which of `METRICS` to measure; what is not asked for costs nothing. PSNR always comes along. LPIPS is left None where its
            package or weights are missing (`evaluate.lpips.missing` says what).
        scheme: the regions that masks refer to.

    Raises:
        OptionError: there is no such metric, or FLIP's package is missing.
    """

    def __init__(self, metrics: Collection[str] = DEFAULT_METRICS, scheme: RegionScheme | Partition = PAPER) -> None:
        require_metrics(metrics)
        self._metrics = frozenset(metrics)
        self._scheme = scheme
        self._networks: dict[str, LpipsNetwork | None] = (
            {name: open_network(name) for name in NETWORKS} if "lpips" in self._metrics else {}
        )
        self._images: list[ImageScore] = []
        self._pixels = np.zeros(len(scheme.regions), np.int64)
        self._squared_errors = np.zeros(len(scheme.regions))
        self._flip_errors = np.zeros(len(scheme.regions))
        self._has_regions = False

    def add(
        self,
        view: View,
        drawn: Float[np.ndarray, "h w 3"],
        truth: UInt8[np.ndarray, "h w 3"],
        region_of_pixel: UInt8[np.ndarray, "h w"] | None = None,
    ) -> ImageScore:
        """Compare one drawn image with its capture.

        Args:
            view: which one.
            drawn: (h, w, 3) sRGB in [0, 1]; clamped if beyond.
            truth: (h, w, 3) the captured image.
            region_of_pixel: (h, w) place in the scheme's regions that each pixel shows, anything beyond them where it shows none.

        Returns:
            Its figures.
        """
        errors = flip_map(drawn, truth) if "flip" in self._metrics else None
        lpips = {f"lpips_{name}": net(drawn, truth) for name, net in self._networks.items() if net is not None}
        score = ImageScore(
            view.timestep,
            view.camera_index,
            psnr(drawn, truth),
            ssim(drawn, truth) if "ssim" in self._metrics else float("nan"),
            None if errors is None else float(errors.mean(dtype=np.float64)),
            **lpips,
        )
        self._images.append(score)
        if region_of_pixel is not None:
            self._add_regions(drawn, truth, errors, region_of_pixel)
        return score

    def _add_regions(
        self,
        drawn: Float[np.ndarray, "h w 3"],
        truth: UInt8[np.ndarray, "h w 3"],
        flip_errors: Float[np.ndarray, "h w"] | None,
        region_of_pixel: UInt8[np.ndarray, "h w"],
    ) -> None:
        """Add one image's errors to those of the regions."""
        self._has_regions = True
        n = len(self._scheme.regions)
        shown = region_of_pixel < n
        labels = region_of_pixel[shown]
        squared = np.square(unit_range(drawn) - unit_range(truth)).sum(axis=2)[shown]
        self._pixels += np.bincount(labels, minlength=n)
        self._squared_errors += np.bincount(labels, squared, n)
        if flip_errors is not None:
            self._flip_errors += np.bincount(labels, flip_errors[shown], n)

    def scores(self) -> ViewScores:
        """Give the figures of all images that were added."""
        regions = {}
        for label, name in enumerate(self._scheme.regions if self._has_regions else ()):
            pixels, squared = int(self._pixels[label]), float(self._squared_errors[label])
            decibels = float(-10 * np.log10(squared / (3 * pixels))) if squared > 0 else None
            flip = float(self._flip_errors[label] / pixels) if pixels and "flip" in self._metrics else None
            regions[name] = RegionQuality(decibels, flip, pixels)
        return ViewScores(tuple(self._images), regions)
