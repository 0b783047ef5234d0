"""The photometric losses and their gradient in one pass: L1, SSIM, and cross-entropy of the sensitivity channel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.perception.kernels.entropy import LOWEST, entropy_band
from sacha_core.perception.kernels.structural import gradient_band, ssim_band

__all__ = ["ImageLoss", "ImageLosses"]

Share = Callable[[Callable[[int, int], None], int], None]

BANDS = 8  # fixed, so that sums are made in the same order by any number of threads


@dataclass(frozen=True)
class ImageLosses:
    """What one image costs, each part before its weight.

    Args:
        l1: mean absolute difference.
        ssim: mean structural similarity.
        entropy: mean binary cross-entropy of the sensitivity channel; 0 where there is none.
        total: the weighted sum.
        gradient: (c, h, w) of `total` by the image; belongs to the `ImageLoss` and is overwritten by its next call.
    """

    l1: float
    ssim: float
    entropy: float
    total: float
    gradient: Float[np.ndarray, "c h w"]


def in_turn(task: Callable[[int, int], None], jobs: int) -> None:
    """Call task(0, job) for each job."""
    for job in range(jobs):
        task(0, job)


class ImageLoss:
    """Computes losses; keeps its buffers from call to call.

    Args:
        l1_weight: of the mean absolute difference.
        ssim_weight: of 1 - SSIM.
        entropy_weight: of the cross-entropy.
        share: calls task(worker, job) once for each of a number of jobs, on some threads; None calls them in turn. The result is the same
            to the bit.

    Source: Qian et al., GaussianAvatars, CVPR 2024 (0.8 L1 + 0.2 (1 - SSIM)); Zhou et al., Perceptual-GS, 2025 (cross-entropy).
    """

    def __init__(
        self,
        l1_weight: float = 0.8,
        ssim_weight: float = 0.2,
        entropy_weight: float = 0.01,
        share: Share | None = None,
    ) -> None:
        self.l1_weight, self.ssim_weight, self.entropy_weight = l1_weight, ssim_weight, entropy_weight
        self._share = in_turn if share is None else share
        self._store = np.empty(0, np.float32)

    def __call__(
        self,
        image: Float[np.ndarray, "c h w"],
        target: UInt8[np.ndarray, "c3 h w"] | Float[np.ndarray, "c3 h w"],
        sensitivity: UInt8[np.ndarray, "h w"] | None = None,
        pixels: int | None = None,
    ) -> ImageLosses:
        """Compare an image with its target.

        Args:
            image: (c, h, w) float32; the channel after the target's, if any, is the sensitivity's.
            target: (c3, h, w) uint8, or float32 in [0, 1].
            sensitivity: (h, w) reference sensitivity, 255 stands for 1; None leaves that channel without gradient.
            pixels: number of pixels that means are taken over, where `image` is the part of a larger one outside of which image and
                target agree and no sensitivity is wanted or given; default: those of `image`.
        """
        colours, height, width = target.shape
        count = height * width if pixels is None else pixels
        outside = count - height * width
        planes = self._buffers(3 * colours + len(image) + 1, height, width)
        d_mean, d_square, d_cross = planes[: 3 * colours].reshape(3, colours, height, width)
        gradient, clamped = planes[3 * colours : -1], planes[-1]
        unit = np.float32(1 / 255 if target.dtype == np.uint8 else 1)
        sums = np.zeros((2, BANDS, 1))
        edges = [height * band // BANDS for band in range(BANDS + 1)]
        ssim_weight = np.float32(-self.ssim_weight / (colours * count))
        l1_weight = np.float32(self.l1_weight / (colours * count))
        entropy_weight = np.float32(self.entropy_weight / count)

        def statistics(_: int, band: int) -> None:
            derivatives = (d_mean, d_square, d_cross)
            ssim_band(image, target, unit, edges[band], edges[band + 1], *derivatives, sums[0, band])

        def gradients(_: int, band: int) -> None:
            top, bottom = edges[band], edges[band + 1]
            weights = (ssim_weight, l1_weight)
            gradient_band(
                image, target, unit, top, bottom, d_mean, d_square, d_cross, *weights, gradient, sums[1, band]
            )
            if sensitivity is not None:
                out = gradient[colours]
                entropy_band(image[colours], sensitivity, top, bottom, entropy_weight, out, clamped)
            elif len(image) > colours:
                gradient[colours:, top:bottom] = 0

        self._share(statistics, BANDS)
        self._share(gradients, BANDS)
        ssim = 1 - sums[0].sum() / (colours * count)
        l1 = sums[1].sum() / (colours * count)
        entropy = 0.0
        if sensitivity is not None:
            entropy = (_cross_entropy(clamped, sensitivity) - outside * float(np.log1p(-LOWEST))) / count
        total = self.l1_weight * l1 + self.ssim_weight * (1 - ssim) + self.entropy_weight * entropy
        return ImageLosses(float(l1), float(ssim), entropy, float(total), gradient)

    def _buffers(self, planes: int, height: int, width: int) -> Float[np.ndarray, "p h w"]:
        size = planes * height * width
        if len(self._store) < size:
            self._store = np.empty(size, np.float32)
        return self._store[:size].reshape(planes, height, width)


def _cross_entropy(clamped: Float[np.ndarray, "h w"], target: UInt8[np.ndarray, "h w"]) -> float:
    """Sum over all pixels; `clamped` is away from 0 and 1."""
    present, absent = np.log(clamped), np.log1p(-clamped)
    mixed = absent + (present - absent) * (target * np.float32(1 / 255))
    return -float(mixed.sum(dtype=np.float64))
