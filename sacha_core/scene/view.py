"""One number a triangle, as a picture of it: values, colours and their legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

__all__ = ["View"]


@dataclass(frozen=True)
class View:
    """One number a triangle, its colours, and what they mean.

    Args:
        values: (f,) int32.
        colours: (f, 4) linear RGBA.
        legend: lines from top to bottom: `label`, `colour` (linear RGB), and for regions `triangles` and `gaussians`.
    """

    values: Int[np.ndarray, " f"]
    colours: Float[np.ndarray, "f 4"]
    legend: list[dict[str, Any]]
