"""Levels: how coarse every attribute may be. 1 is the smallest file, 4 the best picture; a level exists at every real number.

Only the encoder reads this; every number reaches the decoder in the stream.

Source: own; motion steps as tuned on tracked sequences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sacha_core.codec.steps import PER_OCTAVE, StepRule
from sacha_core.errors import OptionError

__all__ = ["LEVELS", "MAX_QUALITY", "MIN_QUALITY", "Level", "level_at", "level_named"]

MIN_QUALITY, MAX_QUALITY = -1.0, 6.0
ATTRIBUTES = ("position", "scale", "rotation", "colour", "harmonic")
OCTAVES_PER_LEVEL = 1.0  # by which every step shrinks from a level to the next


@dataclass(frozen=True)
class Level:
    """Quantisation of everything.

    Args:
        number: what files say of it, to hundredths: information only.
        quality: the real number that the level was made from.
        opacity_steps: steps from transparent to opaque, uniform in arcsin(sqrt(opacity)).
        exponents: added to the base exponent of each of `ATTRIBUTES`, eighths of an octave.
        lagrangian: bits of an attribute against its squared error, which is 1/12 a component at a uniform quantiser of the rule's step: 0
            takes the nearest level whatever it costs.
        max_thinness: a scale this much smaller (natural logarithm) than the next larger one is raised to it.
        vertex_error_mm: of a motion, that is aimed at where the head is known: norm, RMS over vertices and frames.
        expression_step: of expression weights, where it is not.
        shape_step: of identity coefficients.
        angle_step_rad: of rotations, likewise.
        translation_step: of the head's position, metres, likewise.
        offset_step: of personal vertex offsets, metres.
    """

    number: float
    quality: float
    opacity_steps: int
    exponents: tuple[int, ...]
    lagrangian: float
    max_thinness: float
    vertex_error_mm: float
    expression_step: float
    shape_step: float
    angle_step_rad: float
    translation_step: float
    offset_step: float

    def exponent(self, attribute: str) -> int:
        """Exponent added to the rules of one of `ATTRIBUTES`."""
        return self.exponents[ATTRIBUTES.index(attribute)]


@dataclass(frozen=True)
class Anchor:
    """What is given at the whole numbers; between them it is interpolated geometrically."""

    opacity_steps: float
    lagrangian: float
    max_thinness: float
    vertex_error_mm: float
    expression_step: float
    shape_step: float
    angle_step_rad: float
    translation_step: float
    offset_step: float


ANCHORS = (
    Anchor(19, 0.045, 2.5, 0.25, 0.06, 0.01, 0.005, 5e-4, 2e-4),
    Anchor(29, 0.045, 3.0, 0.09, 0.02, 0.005, 0.002, 2e-4, 1e-4),
    Anchor(45, 0.045, 4.0, 0.03, 0.005, 0.005, 5e-4, 5e-5, 5e-5),
    Anchor(64, 0.045, 4.5, 0.012, 0.0025, 0.0025, 2.5e-4, 2e-5, 2e-5),
)


def between(quality: float, name: str) -> float:
    """Interpolate one number of the anchors, geometrically; beyond the last anchors with the slope between them."""
    below = min(max(math.floor(quality), 1), len(ANCHORS) - 1)
    low, high = (getattr(ANCHORS[below + side - 1], name) for side in (0, 1))
    return float(low * (high / low) ** (quality - below)) if low > 0 else float(low)


def level_at(quality: float) -> Level:
    """Give the level at a real number: 1 to 4 are the four levels, more is finer.

    Exponents are whole, so that each attribute moves at a place of its own between two levels: sizes follow `quality` in small steps.

    Raises:
        OptionError: `quality` is outside `MIN_QUALITY` to `MAX_QUALITY`.
    """
    if not MIN_QUALITY <= quality <= MAX_QUALITY:
        raise OptionError(f"quality {quality!r} is outside {MIN_QUALITY:g} to {MAX_QUALITY:g}")
    finer = (2.0 - quality) * OCTAVES_PER_LEVEL * PER_OCTAVE
    exponents = tuple(math.floor(finer + (place + 0.5) / len(ATTRIBUTES)) for place in range(len(ATTRIBUTES)))
    inside = min(
        max(quality, 1.0), float(len(ANCHORS))
    )  # a motion never becomes coarser or finer than at the four levels
    return Level(
        number=round(quality, 2),
        quality=quality,
        opacity_steps=round(between(quality, "opacity_steps")),
        exponents=exponents,
        lagrangian=between(quality, "lagrangian"),
        max_thinness=between(inside, "max_thinness"),
        vertex_error_mm=between(inside, "vertex_error_mm"),
        expression_step=between(inside, "expression_step"),
        shape_step=between(inside, "shape_step"),
        angle_step_rad=between(inside, "angle_step_rad"),
        translation_step=between(inside, "translation_step"),
        offset_step=between(inside, "offset_step"),
    )


LEVELS = {number: level_at(float(number)) for number in (1, 2, 3, 4)}

# Rules at exponent 0, found by descent on rendering error at equal size, on a real avatar without harmonics and on trained ones with
# them. Fields: weights of transparency, size, elongation (quarters); reference (the encoder fits it); low, high; base exponent.
SCALE_RULES = (
    StepRule(2, 0, 0, 0, 0, 32, 75),
    StepRule(3, 0, 0, 0, 0, 44, 71),
    StepRule(3, 0, 0, 0, 0, 48, 75),
)
ROTATION_RULES = (StepRule(5, 6, 3, 0, -12, 48, 79),) * 3  # about the longest, the middle and the shortest axis
POSITION_RULE = StepRule(4, 1, 1, 0, -8, 68, 95)
COLOUR_RULES = (  # luma, then the colour differences
    StepRule(4, 2, 0, 0, -24, 44, 79),
    StepRule(4, 3, 1, 0, -24, 36, 79),
    StepRule(5, 3, 0, 0, -24, 40, 83),
)
HARMONIC_RULE = StepRule(4, 2, 0, 0, -24, 44, 87)  # of a component whose errors are worth as much as those of degree 0


def level_named(level: int) -> Level:
    """Give a level by its number.

    Raises:
        OptionError: there is none.
    """
    if level not in LEVELS:
        raise OptionError(f"level {level!r} does not exist; levels are 1 (smallest) to 4 (best)")
    return LEVELS[level]
