"""The palettes of views: rows of colours that say more or less of something, to people of all kinds of colour vision.

`magnitude` runs from a light yellow over orange and red to nearly black: it is lightness that tells more from less, which no kind of colour
blindness takes away, nor a print in grey. `diverging` runs from dark blue (less) over nearly white (no change) to dark orange (more): blue
and orange are the pair that protanopes, deuteranopes and tritanopes all tell apart. Row 0 of both is the grey of "none" or "not known".
Regions have the colours of their scheme.

Source: own stops; the choice of hues after Okabe and Ito, Color Universal Design, 2008.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float, UInt8

from sacha_core.scene.colours import linear_colours

__all__ = ["DIVERGING", "MAGNITUDE", "MIDDLE", "REGION", "STEPS", "Palettes", "palette_bytes", "palette_colours"]

MAGNITUDE, DIVERGING, REGION = "magnitude", "diverging", "region"
STEPS = 127  # colours of a ramp: finer ones nobody tells apart; with the one for none they are 128
MIDDLE = (STEPS + 1) // 2  # the row of no change in `diverging`

# sRGB
NONE = {MAGNITUDE: (216, 216, 216), DIVERGING: (150, 150, 150)}
STOPS = {
    MAGNITUDE: ((255, 237, 160), (254, 178, 76), (240, 59, 32), (128, 0, 38), (32, 0, 28)),
    DIVERGING: ((3, 38, 84), (0, 98, 172), (110, 178, 226), (247, 247, 245), (246, 176, 92), (200, 92, 0), (92, 34, 0)),
}


@dataclass(frozen=True)
class Palettes:
    """All palettes of a scene, as linear RGBA, which is what renderers keep in meshes.

    Args:
        magnitude: (128, 4) row 0 for none, then from little to much.
        diverging: (128, 4) row 0 for unknown, then from less over none (row 64) to more.
        region: (r, 4) of the regions.
    """

    magnitude: Float[np.ndarray, "p 4"]
    diverging: Float[np.ndarray, "p 4"]
    region: Float[np.ndarray, "r 4"]


@cache
def palette_bytes(name: str) -> UInt8[np.ndarray, "p 3"]:
    """Give a palette as sRGB in whole bytes, so that pictures have exactly these colours."""
    stops = np.array(STOPS[name], np.float64)
    place = np.linspace(0, len(stops) - 1, STEPS)
    ramp = np.stack([np.interp(place, np.arange(len(stops)), stops[:, channel]) for channel in range(3)], axis=-1)
    return np.concatenate([np.array([NONE[name]]), np.rint(ramp)]).astype(np.uint8)


def palette_colours(name: str, region_colours: Float[np.ndarray, "r 4"]) -> Float[np.ndarray, "p 4"]:
    """Give a palette as linear RGBA, float32."""
    return region_colours if name == REGION else linear_colours(palette_bytes(name))
