"""Which region each Gaussian of a run belongs to, and how many each region has."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import find_scheme

__all__ = ["Regions", "head_regions"]


@dataclass(frozen=True)
class Regions:
    """Labels of a head's triangles.

    Args:
        labels: (f,) region of each triangle.
        n_regions: number of regions.
        names: of the regions, in order.
    """

    labels: UInt8[np.ndarray, " f"]
    n_regions: int
    names: tuple[str, ...] = ()

    @classmethod
    def of_partition(cls, partition: Partition) -> Regions:
        """Give those of a head that is divided already."""
        return cls(partition.labels, len(partition.regions), partition.regions)

    def of(self, binding: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
        """Give each Gaussian's region."""
        of: np.ndarray = self.labels[binding]
        return of

    def counts(self, binding: Int[np.ndarray, " n"]) -> tuple[int, ...]:
        """Count Gaussians by region."""
        return tuple(np.bincount(self.labels[binding], minlength=self.n_regions).tolist())

    def factors(self, weights: Iterable[tuple[str, float]]) -> Float[np.ndarray, " r"]:
        """Give each region's weight: 1 where it is not named, and the product where it is named again.

        Raises:
            OptionError: a name is of no region.
        """
        factors = np.ones(self.n_regions)
        for name, weight in weights:
            if name not in self.names:
                raise OptionError(f"density.region_weights names {name!r}, expected one of {', '.join(self.names)}")
            factors[self.names.index(name)] *= weight
        return factors


def head_regions(head: HeadModel, scheme: str) -> Regions:
    """Label a head's triangles by a scheme.

    Raises:
        OptionError: no scheme has that name.
        HeadError: the head lacks what the scheme needs.
    """
    found = find_scheme(scheme)
    return Regions(label_triangles(head, found), len(found.regions), tuple(found.regions))
