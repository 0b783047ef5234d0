"""One number a triangle, as a picture of it: values, the colour of each, and what the colours mean."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sacha_core.scene.palettes import palette_colours

__all__ = ["RegionNumber", "View"]

Numbers = Int[np.ndarray, " f"] | Float[np.ndarray, " f"]


@dataclass(frozen=True)
class RegionNumber:
    """What a view says of a whole region.

    Args:
        value: NaN where nothing is known.
        level: its colour, a row of the palette.
        text: the value as people read it.
    """

    value: float
    level: int
    text: str


@dataclass(frozen=True)
class View:
    """One number a triangle, its colours, and what they mean.

    Args:
        label: what it is called, in a word or three.
        unit: of the values; empty where they have none.
        about: a sentence that says what it is, and of whom the numbers of whole regions are totals or means.
        values: (f,) int32 or float32; NaN where nothing is known.
        levels: (f,) the colour of each triangle, a row of the palette.
        palette: name of the palette, an array of `Palettes`.
        legend: lines from top to bottom: `label`, and `level`, a row of the palette.
        by_region: the number of each region, in the scheme's order; empty where regions are not known.
    """

    label: str
    unit: str
    about: str
    values: Numbers
    levels: Int[np.ndarray, " f"]
    palette: str
    legend: list[dict[str, Any]]
    by_region: list[RegionNumber] = field(default_factory=list)

    def colours(self, region_colours: Float[np.ndarray, "r 4"]) -> Float[np.ndarray, "f 4"]:
        """Give the colour of every triangle, linear RGBA.

        Args:
            region_colours: (r, 4) of the scheme, for the view of the regions themselves.
        """
        colours: np.ndarray = palette_colours(self.palette, region_colours)[self.levels]
        return colours
