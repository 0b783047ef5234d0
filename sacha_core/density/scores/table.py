"""The importance scores by name, each with what it is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.density.scores.perceptual import perceptual_score
from sacha_core.density.scores.removal import removal_score
from sacha_core.density.scores.volume import POWER

__all__ = ["KNOWN_SCORES", "Evidence", "Score"]

SQUARED, ABSOLUTE = 0, 1  # kinds of change that the pass `removal` sums, in its order


@dataclass(frozen=True)
class Evidence:
    """What scores are made of.

    Args:
        sums: by the name of a pass over training views, what it summed for each of n Gaussians; `weights` is always there: (n, 2) blending
            weight over pixels and views, plain and weighted by reference sensitivity.
        sensitivity: (n,) learnt, in (0, 1).
        scales: (n, 3) standard deviations, of one space.
        pixel_factor: lambda_S.
        gaussian_factor: lambda_a.
        volume_percentile: of the volumes that counts as 1 (V90).
        volume_power: to which volumes enter.
    """

    sums: Mapping[str, Float[np.ndarray, "n ..."]]
    sensitivity: Float[np.ndarray, " n"]
    scales: Float[np.ndarray, "n 3"]
    pixel_factor: float = 1.0
    gaussian_factor: float = 1.0
    volume_percentile: float = 90.0
    volume_power: float = POWER


@dataclass(frozen=True)
class Score:
    """An importance score.

    Args:
        of: gives (n,) not negative numbers; the lowest go first.
        passes: over training views that it needs besides `weights`, by the names of the trainer's table.
    """

    of: Callable[[Evidence], Float[np.ndarray, " n"]]
    passes: tuple[str, ...] = ()


def _perceptual(found: Evidence) -> Float[np.ndarray, " n"]:
    plain, sensitive = found.sums["weights"].T
    factors = (found.pixel_factor, found.gaussian_factor)
    volume = (found.volume_percentile, found.volume_power)
    return perceptual_score(plain, sensitive, found.sensitivity, found.scales, *factors, *volume)


def _light_gaussian(found: Evidence) -> Float[np.ndarray, " n"]:
    return light_gaussian_score(found.sums["weights"][:, 0], found.scales, power=found.volume_power)


def _removal(kind: int) -> Score:
    """Make a removal score of one of the kinds of change that the pass `removal` sums."""

    def of(found: Evidence) -> Float[np.ndarray, " n"]:
        plain, sensitive = found.sums["removal"][:, 2 * kind : 2 * kind + 2].T
        return removal_score(plain, sensitive, found.sensitivity, found.pixel_factor, found.gaussian_factor)

    return Score(of, ("removal",))


KNOWN_SCORES = {
    "pis": Score(_perceptual),
    "lgs": Score(_light_gaussian),
    "removal": _removal(SQUARED),
    "removal-absolute": _removal(ABSOLUTE),
}
