"""Colours of a person, drawn by chance from natural ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["Palette", "draw_palette", "linear"]

# sRGB bytes.
SKINS = ((226, 182, 158), (236, 196, 174), (203, 152, 121), (168, 115, 86), (120, 78, 56))
HAIRS = ((86, 58, 40), (52, 38, 31), (128, 88, 52), (150, 112, 70), (108, 52, 30), (34, 29, 28))
IRISES = ((92, 122, 148), (104, 124, 92), (112, 78, 46), (76, 50, 34), (110, 112, 108))
CLOTHS = ((44, 84, 104), (112, 44, 52), (58, 70, 62), (74, 70, 96), (150, 138, 118))


@dataclass(frozen=True)
class Palette:
    """Linear RGB of what a person is made of.

    Args:
        skin: on the cheek.
        hair: in the middle of a strand.
        iris: halfway between pupil and border.
        cloth: of the shirt.
    """

    skin: Float[np.ndarray, "3"]
    hair: Float[np.ndarray, "3"]
    iris: Float[np.ndarray, "3"]
    cloth: Float[np.ndarray, "3"]


def linear(srgb: tuple[int, int, int]) -> Float[np.ndarray, "3"]:
    """Give linear RGB of sRGB bytes."""
    encoded = np.array(srgb) / 255
    decoded: np.ndarray = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return decoded


def draw_palette(seed: int) -> Palette:
    """Give the colours that belong to a seed; seed 0 has the first of each list."""
    rng = np.random.default_rng(seed)
    picks = [linear(shades[rng.integers(len(shades)) if seed else 0]) for shades in (SKINS, HAIRS, IRISES, CLOTHS)]
    return Palette(*picks)
