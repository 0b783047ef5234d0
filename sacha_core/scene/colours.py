"""Colours that say a number, as linear light, which is what renderers keep in meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

__all__ = ["count_legend", "linear_colours", "linear_count_colours", "srgb_bytes"]

# Grey for none, then from light to dark, so that order can be seen without colour and in print; sRGB.
NONE = (216, 216, 216)
RAMP = ((255, 237, 160), (254, 178, 76), (240, 59, 32), (128, 0, 38), (32, 0, 28))
TICKS = (0, 1, 2, 5)  # of the legend, and their tens, hundreds ...


def linear_colours(srgb: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Turn sRGB colours, 0 to 255, into opaque linear RGBA, float32.

    Source: IEC 61966-2-1.
    """
    encoded = srgb.astype(np.float64) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.concatenate([linear, np.ones_like(linear[:, :1])], axis=1).astype(np.float32)


def srgb_bytes(linear: Float[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Turn linear light, clipped to 0 to 1, into sRGB bytes: the inverse of `linear_colours`, to the byte.

    Source: IEC 61966-2-1.
    """
    light = np.clip(linear.astype(np.float64), 0, 1)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    srgb: np.ndarray = np.rint(255 * encoded).astype(np.uint8)
    return srgb


def linear_count_colours(count: Int[np.ndarray, " f"]) -> Float[np.ndarray, "f 4"]:
    """Give the colour of each count, on a logarithmic ramp from 1 to the largest; linear RGBA, float32."""
    return linear_colours(_ramp(count, int(count.max(initial=0))))


def count_legend(largest: int) -> list[dict[str, Any]]:
    """Give the lines of the legend of counts up to `largest`: round numbers, and the largest itself."""
    ticks = {tick * 10**power for power in range(len(str(largest))) for tick in TICKS}
    shown = np.array(sorted({tick for tick in ticks if tick < largest} | {largest}))
    colours = linear_colours(_ramp(shown, largest))
    return [
        {"label": f"{n:,}", "colour": colour[:3].tolist()} for n, colour in zip(shown.tolist(), colours, strict=True)
    ]


def _ramp(count: Int[np.ndarray, " n"], largest: int) -> UInt8[np.ndarray, "n 3"]:
    """Give the sRGB colour of each count, in whole bytes: a picture of the mesh then has exactly these."""
    place = np.log(np.maximum(count, 1)) / np.log(max(largest, 2)) * (len(RAMP) - 1)
    stops = np.arange(len(RAMP))
    ramp = np.stack([np.interp(place, stops, [colour[channel] for colour in RAMP]) for channel in range(3)], axis=-1)
    return np.where(count[:, None] == 0, np.array(NONE), np.rint(ramp)).astype(np.uint8)
