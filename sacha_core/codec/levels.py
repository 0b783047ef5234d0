"""The four levels: how coarse every attribute may be. 1 is the smallest file, 4 the best picture.

Only the encoder reads this; every number reaches the decoder in the stream.

Source: own; motion steps as tuned on tracked sequences.
"""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.codec.steps import StepRule
from sacha_core.errors import OptionError

__all__ = ["LEVELS", "Level", "level_named"]


@dataclass(frozen=True)
class Level:
    """Quantisation of everything.

    Args:
        number: 1 to 4.
        opacity_steps: steps from transparent to opaque, uniform in arcsin(sqrt(opacity)).
        exponent: added to the base exponent of every Gaussian attribute, half octaves.
        max_thinness: a scale this much smaller (natural logarithm) than the next larger one is raised to it.
        expression_step: of expression weights.
        shape_step: of identity coefficients.
        angle_step_rad: of rotations.
        translation_step: of the head's position, metres.
        offset_step: of personal vertex offsets, metres.
    """

    number: int
    opacity_steps: int
    exponent: int
    max_thinness: float
    expression_step: float
    shape_step: float
    angle_step_rad: float
    translation_step: float
    offset_step: float


LEVELS = {
    1: Level(1, 24, 2, 2.5, 0.06, 0.01, 0.005, 5e-4, 2e-4),
    2: Level(2, 36, 0, 3.0, 0.02, 0.005, 0.002, 2e-4, 1e-4),
    3: Level(3, 56, -2, 4.0, 0.005, 0.005, 5e-4, 5e-5, 5e-5),
    4: Level(4, 80, -4, 4.5, 0.0025, 0.0025, 2.5e-4, 2e-5, 2e-5),
}

# Rules at exponent 0, found by descent on rendering error at equal size, on a real avatar without harmonics and on trained ones with
# them. Fields: weights of transparency, size, elongation (quarters); reference (the encoder fits it); low, high; base exponent.
SCALE_RULES = (
    StepRule(2, 0, 0, 0, 0, 8, 19),
    StepRule(3, 0, 0, 0, 0, 11, 18),
    StepRule(3, 0, 0, 0, 0, 12, 19),
)
ROTATION_RULE = StepRule(5, 6, 3, 0, -3, 12, 20)
POSITION_RULE = StepRule(4, 1, 1, 0, -2, 17, 24)
COLOUR_RULES = (  # luma, then the colour differences
    StepRule(4, 2, 0, 0, -6, 11, 20),
    StepRule(4, 3, 1, 0, -6, 9, 20),
    StepRule(5, 3, 0, 0, -6, 10, 21),
)
HARMONIC_RULES = (  # luma of degree 1, 2, 3, then the colour differences
    StepRule(4, 2, 0, 0, -6, 11, 19),
    StepRule(4, 2, 0, 0, -6, 11, 19),
    StepRule(4, 2, 0, 0, -6, 11, 19),
    StepRule(4, 3, 0, 0, -6, 11, 20),
    StepRule(4, 3, 0, 0, -6, 11, 21),
    StepRule(4, 3, 0, 0, -6, 11, 21),
)
HARMONIC_DEAD_ZONE = 0.0


def level_named(level: int) -> Level:
    """Give a level by its number.

    Raises:
        OptionError: there is none.
    """
    if level not in LEVELS:
        raise OptionError(f"level {level!r} does not exist; levels are 1 (smallest) to 4 (best)")
    return LEVELS[level]
