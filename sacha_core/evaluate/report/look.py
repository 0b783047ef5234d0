"""How each variant is drawn, the same in every figure, and told apart with any colour vision."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FAINT", "GRID", "INK", "Look", "look_of"]

INK, FAINT, GRID = "#202124", "#5f6368", "#e3e5e8"


@dataclass(frozen=True)
class Look:
    """How a variant is drawn.

    Args:
        colour: as `#rrggbb`.
        marker: Matplotlib's.
        line: Matplotlib's; controls are broken.
        filled: whether markers are; controls' are hollow.
        width: of lines, points.
    """

    colour: str
    marker: str
    line: str = "-"
    filled: bool = True
    width: float = 1.3


# Colours after Okabe and Ito, Color Universal Design, 2008, their yellow darkened to be seen on white; markers differ as well
BLUE, SKY, GREEN, ORANGE, RED, PINK, OLIVE = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7", "#8F8A00"
LOOKS = {
    "ga": Look("#000000", "X"),
    "mask": Look("#777777", "p"),
    "default": Look(BLUE, "o"),
    "default-seen": Look(SKY, "s"),
    "default-gp-pis": Look(OLIVE, "h"),
    "rad": Look(GREEN, "^"),
    "rad-gp-lgs": Look("#7A5230", "v"),
    "rad-gp-pis": Look(ORANGE, "D"),
    "paper": Look(PINK, "P"),
    "paper-inverted": Look(PINK, "P", "--", filled=False, width=1.0),
    "paper-random": Look(PINK, "P", ":", filled=False, width=1.0),
    "sacha": Look(RED, "*", width=2.0),
    "sacha-uniform": Look(RED, "*", "-.", filled=False, width=1.0),
    "sacha-inverted": Look(RED, "*", "--", filled=False, width=1.0),
    "sacha-random": Look(RED, "*", ":", filled=False, width=1.0),
}
OTHER_MARKERS = "<>8Hd1234"


def look_of(variant: str, place: int = 0) -> Look:
    """Give a variant's look; one that is not known is grey, with a marker by its place."""
    return LOOKS.get(variant) or Look("#999999", OTHER_MARKERS[place % len(OTHER_MARKERS)])
