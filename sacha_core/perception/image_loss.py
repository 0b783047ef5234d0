"""The photometric losses and their gradient in one pass: L1, SSIM, and cross-entropy of the sensitivity channel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float, Int, UInt8

from sacha_core.errors import OptionError
from sacha_core.parallel.buffers import Buffers
from sacha_core.parallel.kernels.lanes import LANES
from sacha_core.parallel.pool import Pool
from sacha_core.perception.kernels.differences import strip_spans
from sacha_core.perception.kernels.entropy import LOWEST
from sacha_core.perception.kernels.parts import compare_parts
from sacha_core.perception.kernels.structural import STRIP, STRIP_SPACE

__all__ = ["Box", "ImageLoss", "ImageLosses"]

F = np.float32
BANDS = 8  # of the sensitivity, which come last: small, so that threads finish together
NO_MARKS = np.zeros((0, 0), np.uint8)
Box = tuple[int, int, int, int]  # left, top, right, bottom; pixels, exclusive


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


class ImageLoss:
    """Computes losses; keeps its buffers from call to call.

    Where image and target are the same to the bit, and no sensitivity is wanted or given, the loss is 0 and so is its gradient: such parts
    cost next to nothing, and a crop that leaves only such parts out changes no bit of the gradient.

    Args:
        l1_weight: of the mean absolute difference.
        ssim_weight: of 1 - SSIM.
        entropy_weight: of the cross-entropy.
        pool: shares out the work; None for the calling thread alone. The result is the same to the bit.

    Source: Qian et al., GaussianAvatars, CVPR 2024 (0.8 L1 + 0.2 (1 - SSIM)); Zhou et al., Perceptual-GS, 2025 (cross-entropy).
    """

    def __init__(
        self,
        l1_weight: float = 0.8,
        ssim_weight: float = 0.2,
        entropy_weight: float = 0.01,
        pool: Pool | None = None,
    ) -> None:
        self.l1_weight, self.ssim_weight, self.entropy_weight = l1_weight, ssim_weight, entropy_weight
        self._pool = pool or Pool(1)
        self._buffers = Buffers()

    def __call__(
        self,
        image: Float[np.ndarray, "c h w"],
        target: UInt8[np.ndarray, "c3 h0 w0"] | Float[np.ndarray, "c3 h0 w0"],
        sensitivity: UInt8[np.ndarray, "h0 w0"] | None = None,
        box: Box | None = None,
    ) -> ImageLosses:
        """Compare an image with its target.

        Args:
            image: (c, h, w) float32; the channel after the target's, if any, is the sensitivity's.
            target: (c3, h0, w0) uint8, or float32 in [0, 1].
            sensitivity: (h0, w0) reference sensitivity, 255 stands for 1; None leaves that channel without gradient.
            box: left, top, right, bottom of the part of the target that `image` shows, where it does not show all: outside of it image
                and target agree, and no sensitivity is wanted or given. Means are over all pixels of the target.

        Raises:
            OptionError: the shapes do not go together.
        """
        colours, whole_height, whole_width = target.shape
        left, top, right, bottom = box or (0, 0, whole_width, whole_height)
        height, width, count = bottom - top, right - left, whole_height * whole_width
        self._check(image, target, sensitivity, (left, top, right, bottom))
        image, target = np.ascontiguousarray(image), np.ascontiguousarray(target)
        gradient = self._buffers.space("gradient", image.size, np.float32).reshape(image.shape)
        edges = strip_edges(width)
        strips, threads, bands = len(edges) - 1, self._pool.threads, 0 if sensitivity is None else BANDS
        sums = np.zeros((2, colours * strips, height), np.float32)
        unit = F(1 / 255 if target.dtype == np.uint8 else 1)
        weights = F(-self.ssim_weight / (colours * count)), F(self.l1_weight / (colours * count))
        marks = NO_MARKS if sensitivity is None else np.ascontiguousarray(sensitivity)
        nats, empty = np.zeros(height, np.float32), np.zeros(bands, np.int64)
        counter, rows = np.zeros(1, np.int64), strip_spans(height)
        space = self._buffers.space("space", threads * STRIP_SPACE, np.float32).reshape(threads, STRIP_SPACE)
        spans = self._buffers.space("spans", threads * 4 * rows, np.int64).reshape(threads, 4, rows)

        def work(worker: int, _: int) -> None:
            compare_parts(
                counter, colours, edges, image.reshape(-1), target.reshape(-1), top * whole_width + left, count, whole_width,
                unit, height, width, *weights, marks.reshape(-1), F(self.entropy_weight / count),
                gradient.reshape(-1), space[worker], spans[worker], *sums, nats, empty,
            )  # fmt: skip

        self._pool.run(work, min(threads, colours * strips + bands))
        if sensitivity is None:
            gradient[colours:] = 0
        ssim = 1 - 2 * float(sums[0].sum(dtype=np.float64)) / (colours * count)
        l1 = float(sums[1].sum(dtype=np.float64)) / (colours * count)
        entropy = 0.0
        if sensitivity is not None:
            unmarked = count - height * width + int(empty.sum())
            entropy = (float(nats.sum(dtype=np.float64)) - unmarked * math.log1p(-LOWEST)) / count
        total = self.l1_weight * l1 + self.ssim_weight * (1 - ssim) + self.entropy_weight * entropy
        return ImageLosses(l1, ssim, entropy, total, gradient)

    @staticmethod
    def _check(image: np.ndarray, target: np.ndarray, sensitivity: np.ndarray | None, box: Box) -> None:
        """Refuse shapes that do not go together."""
        colours, height, width = target.shape
        left, top, right, bottom = box
        if not (0 <= left < right <= width and 0 <= top < bottom <= height):
            raise OptionError(f"the box is {box}, expected one inside the target of {width} x {height} pixels")
        least = colours + (sensitivity is not None)
        if image.shape[1:] != (bottom - top, right - left) or len(image) < least:
            expected = f"({least} or more, {bottom - top}, {right - left})"
            raise OptionError(f"the image has shape {image.shape}, expected {expected} as the target's part")
        if sensitivity is not None and sensitivity.shape != (height, width):
            raise OptionError(
                f"the sensitivity has shape {sensitivity.shape}, expected ({height}, {width}) as the target's"
            )


@cache
def strip_edges(width: int) -> Int[np.ndarray, " e"]:
    """Give the columns at which strips begin and end: about even, whole vectors but for the last."""
    vectors = -(-width // LANES)
    strips = -(-vectors * LANES // STRIP)
    return np.array([*(LANES * (vectors * k // strips) for k in range(strips)), width])
