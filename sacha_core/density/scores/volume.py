"""The factor by which scores discount small Gaussians."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["volume_factor"]

POWER = 0.1


def volume_factor(
    scales: Float[np.ndarray, "n 3"], percentile: float = 90.0, clamp: bool = True, power: float = POWER
) -> Float[np.ndarray, " n"]:
    """Give each Gaussian's volume relative to a percentile of all volumes, to a power.

    Args:
        scales: (n, 3) standard deviations, of one space.
        percentile: of the volumes that counts as 1.
        clamp: whether larger volumes count as 1, too.
        power: to which the ratio is taken.

    Returns:
        (n,) float64; empty for no Gaussians.

    Source: Fan et al., LightGaussian, 2023, equation 3.
    """
    if not len(scales):
        return np.empty(0)
    with np.errstate(over="ignore", invalid="ignore"):
        volume = np.prod(scales, axis=1, dtype=np.float64)  # 4/3 pi cancels
    volume = np.nan_to_num(volume, nan=0.0)  # endless and flat: as good as none; endless alone: the largest number
    reference = np.percentile(volume, percentile)
    ratio = np.divide(volume, reference, out=np.ones_like(volume), where=reference > 0)
    if clamp:
        ratio = np.minimum(ratio, 1.0)
    factor: np.ndarray = ratio**power
    return factor
