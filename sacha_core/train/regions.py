"""Which region each Gaussian of a run belongs to, and how many each region has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int, UInt8

from sacha_core.flame.model import HeadModel
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import find_scheme

__all__ = ["Regions", "head_regions"]


@dataclass(frozen=True)
class Regions:
    """Labels of a head's triangles.

    Args:
        labels: (f,) region of each triangle.
        n_regions: number of regions.
    """

    labels: UInt8[np.ndarray, " f"]
    n_regions: int

    def of(self, binding: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
        """Give each Gaussian's region."""
        of: np.ndarray = self.labels[binding]
        return of

    def counts(self, binding: Int[np.ndarray, " n"]) -> tuple[int, ...]:
        """Count Gaussians by region."""
        return tuple(np.bincount(self.labels[binding], minlength=self.n_regions).tolist())


def head_regions(head: HeadModel, scheme: str) -> Regions:
    """Label a head's triangles by a scheme.

    Raises:
        OptionError: no scheme has that name.
        HeadError: the head lacks what the scheme needs.
    """
    found = find_scheme(scheme)
    return Regions(label_triangles(head, found), len(found.regions))
