"""What pictures change by when Gaussians are removed, one at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["RemovalChanges"]


@dataclass(frozen=True)
class RemovalChanges:
    """By how much sums over pixels and channels grow when one Gaussian is removed, for each of n Gaussians and m images of pixel weights.

    All is 0 for a Gaussian that no pixel shows.

    Args:
        squared: (n, m) of the squared difference from the truth; negative where the picture is better without.
        absolute: (n, m) of the absolute difference from the truth; likewise.
        own_squared: (n, m) of the squared difference from the picture as it is; never negative, and what needs no truth.
        own_absolute: (n, m) of the absolute difference from the picture as it is; likewise.

    Source: own.
    """

    squared: Float[np.ndarray, "n m"]
    absolute: Float[np.ndarray, "n m"]
    own_squared: Float[np.ndarray, "n m"]
    own_absolute: Float[np.ndarray, "n m"]
