"""The photometric losses and their gradient on a device: the twin of `sacha_core.perception.image_loss`."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn.functional import conv2d

from sacha_core.train.options import LossOptions

__all__ = ["DeviceImageLoss"]

RADIUS = 5  # 11 x 11 window, zero padded
C1, C2 = 0.01**2, 0.03**2
LOWEST = float(np.float32(1e-6))
HIGHEST = float(np.float32(1 - 1e-6))


class DeviceImageLoss:
    """L1, SSIM and the cross-entropy of the sensitivity channel, with the gradient in closed form.

    Args:
        options: the losses' weights.
        device: where to compute.

    Source: Qian et al., GaussianAvatars, CVPR 2024 (0.8 L1 + 0.2 (1 - SSIM)); Zhou et al., Perceptual-GS, 2025 (cross-entropy).
    """

    def __init__(self, options: LossOptions, device: torch.device) -> None:
        self._options = options
        taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
        self._taps = torch.tensor(taps / math.fsum(taps), dtype=torch.float32, device=device)

    def __call__(
        self, image: Float[Tensor, "c h w 4"], wanted: UInt8[Tensor, "c 3 h w"], sensitive: UInt8[Tensor, "c h w"]
    ) -> tuple[Float[Tensor, "4"], Float[Tensor, "c h w 4"]]:
        """Compare images with their targets.

        Args:
            image: (c, h, w, 4) red, green, blue and sensitivity.
            wanted: (c, 3, h, w) the targets.
            sensitive: (c, h, w) reference sensitivities, 255 stands for 1.

        Returns:
            Means over the images: the weighted sum, L1, SSIM and cross-entropy; and the gradient of that sum by `image`.
        """
        options, pixels = self._options, sensitive.numel()
        x = image[..., :3].permute(0, 3, 1, 2).contiguous()
        y = wanted * (1 / 255)
        difference = x - y
        ssim, slope = self._similarity(x, y)
        entropy, entropy_slope = cross_entropy(image[..., 3], sensitive * (1 / 255))
        l1 = difference.abs().mean()
        total = options.l1 * l1 + options.ssim * (1 - ssim) + options.sensitivity * entropy
        colour = difference.sign_() * (options.l1 / (3 * pixels)) - slope * (options.ssim / (3 * pixels))
        gradient = torch.cat([colour, entropy_slope[:, None] * (options.sensitivity / pixels)], 1)
        return torch.stack([total, l1, ssim, entropy]), gradient.permute(0, 2, 3, 1).contiguous()

    def _similarity(
        self, x: Float[Tensor, "c 3 h w"], y: Float[Tensor, "c 3 h w"]
    ) -> tuple[Float[Tensor, ""], Float[Tensor, "c 3 h w"]]:
        """Give the mean SSIM, and the gradient of its sum by `x`."""
        mean_x, mean_y, square, cross = self._blur(torch.cat([x, y, x * x + y * y, x * y], 1)).chunk(4, 1)
        product, power = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
        a1, a2 = 2 * product + C1, 2 * (cross - product) + C2
        b1, b2 = power + C1, square - power + C2
        inverse = 1 / (b1 * b2)
        ssim = a1 * a2 * inverse
        by_cross = 2 * a1 * inverse
        by_square = -ssim * b1 * inverse
        by_mean = 2 * inverse * (mean_y * a2 - mean_x * ssim * b2) - mean_y * by_cross - 2 * mean_x * by_square
        back = self._blur(torch.cat([by_mean, by_square, by_cross], 1))
        lost = (1 - ssim).mean()  # near 0 where images agree, so that the sum loses nothing
        return 1 - lost, back[:, :3] + 2 * x * back[:, 3:6] + y * back[:, 6:]

    def _blur(self, planes: Float[Tensor, "c p h w"]) -> Float[Tensor, "c p h w"]:
        """Blur each plane by the window, along rows and then across them.

        As a convolution of each plane by itself, which rounds like any float32 sum: those between planes may run in TF32.
        """
        count = planes.shape[1]
        along = self._taps.expand(count, 1, 1, -1)
        return conv2d(
            conv2d(planes, along, padding=(0, RADIUS), groups=count), along.mT, padding=(RADIUS, 0), groups=count
        )


def cross_entropy(
    predicted: Float[Tensor, "c h w"], wanted: Float[Tensor, "c h w"]
) -> tuple[Float[Tensor, ""], Float[Tensor, "c h w"]]:
    """Give the mean binary cross-entropy, and the gradient of its sum by the prediction; zero where that is clamped."""
    inside = predicted.clamp(LOWEST, HIGHEST)
    present, absent = inside.log(), (-inside).log1p()
    slope = torch.where(predicted == inside, (inside - wanted) / (inside * (1 - inside)), 0)
    return -(absent + (present - absent) * wanted).mean(), slope
