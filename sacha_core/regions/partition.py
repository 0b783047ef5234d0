"""The regions of one head: their names and colours, and which triangle belongs to which, by a scheme or drawn by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER, RegionScheme

__all__ = ["Partition", "partition_by"]


@dataclass(frozen=True)
class Partition:
    """One head's triangles, each in one region.

    Args:
        name: of the scheme.
        regions: name of each region; a region's label is its place here.
        colours: sRGB of each region, 0 to 255, for pictures.
        labels: (f,) region of each triangle.
    """

    name: str
    regions: tuple[str, ...]
    colours: tuple[tuple[int, int, int], ...]
    labels: UInt8[np.ndarray, " f"]

    @property
    def triangle_colours(self) -> UInt8[np.ndarray, "f 3"]:
        """SRGB of each triangle's region, 0 to 255."""
        colours: np.ndarray = np.array(self.colours, np.uint8).reshape(-1, 3)[self.labels]
        return colours

    def label(self, region: str) -> int:
        """Give a region's label.

        Raises:
            OptionError: there is no such region.
        """
        if region not in self.regions:
            raise OptionError(f"scheme {self.name!r} has no region {region!r}; it has {', '.join(self.regions)}")
        return self.regions.index(region)


def partition_by(head: HeadModel, scheme: RegionScheme = PAPER) -> Partition:
    """Divide a head by a scheme of vertex masks.

    Raises:
        HeadError: a mask is missing, or triangles hang together with no masked vertex.
    """
    return Partition(scheme.name, scheme.regions, scheme.colours, label_triangles(head, scheme))
