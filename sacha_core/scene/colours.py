"""Colours that say a number, as linear light, which is what renderers keep in meshes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

__all__ = ["linear_colours", "srgb_bytes"]


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
