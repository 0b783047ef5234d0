"""Colours of a person, drawn by chance from natural ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["Palette", "draw_palette", "linear"]

# sRGB bytes. Each skin with the hair and the irises that often go with it; seed 0 has the first of each.
BROWN, DARK, HAZEL, BLOND, RED, BLACK = (
    (86, 58, 40),
    (52, 38, 31),
    (128, 88, 52),
    (158, 122, 78),
    (122, 60, 36),
    (34, 29, 28),
)
BLUE, GREEN, AMBER, UMBER, GREY = (92, 122, 148), (104, 124, 92), (112, 78, 46), (76, 50, 34), (110, 112, 108)
COMPLEXIONS = (
    ((226, 182, 158), (BROWN, HAZEL, BLOND, DARK), (BLUE, GREEN, AMBER, GREY)),
    ((236, 196, 174), (RED, BLOND, BROWN), (GREEN, BLUE, GREY)),
    ((203, 152, 121), (DARK, BLACK, BROWN), (UMBER, AMBER, GREEN)),
    ((168, 115, 86), (BLACK, DARK), (UMBER, AMBER)),
    ((124, 83, 61), (BLACK, DARK), (UMBER,)),
)
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
    """Give the colours that belong to a seed."""
    rng = np.random.default_rng(seed)
    row, hair, iris, cloth = rng.uniform(size=4) if seed else np.zeros(4)
    skin, hairs, irises = COMPLEXIONS[int(row * len(COMPLEXIONS))]
    shades = (skin, hairs[int(hair * len(hairs))], irises[int(iris * len(irises))], CLOTHS[int(cloth * len(CLOTHS))])
    return Palette(*(linear(shade) for shade in shades))
