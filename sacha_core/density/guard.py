"""The binding guard: no triangle loses its last Gaussian."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

__all__ = ["guarded"]


def guarded(remove: Bool[np.ndarray, " n"], binding: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Take back the removals of every triangle that would be left without a Gaussian.

    A triangle whose Gaussians are all marked keeps all of them, not only the best.

    Args:
        remove: (n,) marked for removal.
        binding: (n,) triangle of each Gaussian.

    Returns:
        (n,) what may be removed.

    Source: GaussianAvatars, pruning with binding; CVPR 2024, section 3.3.
    """
    if not len(binding):
        return remove.copy()
    kept = np.bincount(binding[~remove], minlength=int(binding.max()) + 1)
    allowed: np.ndarray = remove & (kept[binding] > 0)
    return allowed
