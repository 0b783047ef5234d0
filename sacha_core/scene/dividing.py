"""The regions of what is shown: their view, their palette, their table."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from sacha_core.errors import SachaError
from sacha_core.flame.model import HeadModel
from sacha_core.regions.partition import Partition, partition_by
from sacha_core.regions.scheme import find_scheme
from sacha_core.scene.colours import linear_colours
from sacha_core.scene.palettes import DIVERGING, MAGNITUDE, REGION, Palettes, palette_colours
from sacha_core.scene.region_table import RegionTable, region_table
from sacha_core.scene.view import RegionNumber, View

__all__ = ["Divided", "divided"]


@dataclass(frozen=True)
class Divided:
    """A head, or the first triangles of one, in its regions.

    Args:
        regions: of its triangles; None where they are not known.
        palettes: of all views, with the regions' colours.
        views: the view of the regions; empty where they are not known.
        table: how many triangles each has; Gaussians none.
        notes: why they are not known.
    """

    regions: Partition | None
    palettes: Palettes
    views: dict[str, View] = field(default_factory=dict)
    table: RegionTable | None = None
    notes: list[str] = field(default_factory=list)


def divided(head: HeadModel, scheme: str, regions: Partition | None, area_cm2: Float[np.ndarray, " f"]) -> Divided:
    """Divide a head, or say in a note why it cannot be done.

    Args:
        head: whose triangles are shown.
        scheme: by which name regions go that are not given.
        regions: of the head's triangles, or None.
        area_cm2: (f,) of the triangles shown, the first ones of the head's.
    """
    if regions is None:
        try:
            regions = partition_by(head, find_scheme(scheme))
        except SachaError as missing:
            return Divided(None, _palettes(np.zeros((0, 4), np.float32)), notes=[f"No regions: {missing}"])
    regions = replace(regions, labels=regions.labels[: len(area_cm2)])
    colours = linear_colours(np.array(regions.colours, np.uint8).reshape(-1, 3))
    table = region_table(regions, np.zeros(len(area_cm2), np.int32), area_cm2)
    return Divided(regions, _palettes(colours), {"region": _view(regions)}, table)


def _palettes(region: Float[np.ndarray, "r 4"]) -> Palettes:
    return Palettes(palette_colours(MAGNITUDE, region), palette_colours(DIVERGING, region), region)


def _view(regions: Partition) -> View:
    """Give the view of the regions themselves."""
    labels = regions.labels.astype(np.int32)
    legend = [{"label": name, "level": place} for place, name in enumerate(regions.regions)]
    numbers = [RegionNumber(float(place), place, name) for place, name in enumerate(regions.regions)]
    return View("Region", "", "The region that each triangle belongs to", labels, labels, REGION, legend, numbers)
