"""What pictures change by when Gaussians are removed, one at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["RemovalChanges"]


@dataclass(frozen=True)
class RemovalChanges:
    """How far a picture is from what it was when one Gaussian is removed, for each of n Gaussians and m images of pixel weights.

    All is 0 for a Gaussian that no pixel shows.

    Args:
        squared: (n, m) squared difference, summed over pixels and channels.
        absolute: (n, m) absolute difference, likewise.

    Source: own.
    """

    squared: Float[np.ndarray, "n m"]
    absolute: Float[np.ndarray, "n m"]
