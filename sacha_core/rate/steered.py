"""Files of what a budget leaves of an avatar: who stays is for scores and the artist to say, how finely it is coded for pictures.

Source: own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.avatar import Avatar
from sacha_core.codec.levels import Level, level_named
from sacha_core.density.budget import Budget
from sacha_core.density.limits import nearest_possible
from sacha_core.density.rebudget import Rebudget, rebudget
from sacha_core.density.scores_file import Scores
from sacha_core.flame.model import HeadModel
from sacha_core.rate.encoding import Encoded, RenderingEncoder
from sacha_core.regions.partition import Partition

__all__ = ["SteeredEncoder", "error_factors"]

MOST = 64.0  # times as much, or as little, that an error counts beside the mean: beyond, steps leave the range of the rules


class SteeredEncoder:
    """Encodes what a budget leaves of an avatar, exactly these Gaussians, at any number of levels.

    Weights and painted importance act twice: on who stays, and on how much an error counts where bits are given out.

    Args:
        avatar: with the scored Gaussians.
        head: the head that it is bound to.
        scores: of these Gaussians.
        partition: the head's regions.
        budget: who stays. Its share is that of `keep` where that is fixed; else as many stay at each level as are worth their bits
            there, or the nearest number that shares and locks allow.
        fixed_keep: whether the budget's share is.
        embed_head: add the head itself to the files.

    Raises:
        GeometryError: a frame of the motion makes a triangle degenerate.
        HeadError: the motion has components or vertex offsets that the head lacks.
    """

    def __init__(
        self,
        avatar: Avatar,
        head: HeadModel,
        scores: Scores,
        partition: Partition,
        budget: Budget,
        fixed_keep: bool = True,
        embed_head: bool = False,
    ) -> None:
        self.head, self._scores, self._partition = head, scores, partition
        self._budget, self._fixed = budget, fixed_keep
        factors = error_factors(scores, partition, budget)
        self._encoder = RenderingEncoder(avatar, head, embed_head, factors=factors)
        self._chosen: dict[float, Rebudget] = {}  # by quality; one for all where the share is fixed

    def choose(self, level: int | Level) -> Rebudget:
        """Give who stays at a level.

        Raises:
            OptionError: shares and locks leave no way to the budget.
        """
        chosen = level if isinstance(level, Level) else level_named(level)
        key = 0.0 if self._fixed else chosen.quality
        if key not in self._chosen:
            budget = self._budget if self._fixed else replace(self._budget, keep=self._keep_at(chosen))
            self._chosen[key] = rebudget(self._scores, self._partition, budget)
        return self._chosen[key]

    def _keep_at(self, level: Level) -> float:
        """Give the share of the Gaussians that is worth its bits, or the nearest that shares and locks allow."""
        regions = self._partition.labels[self._scores.gaussians.binding]
        there = np.bincount(regions, minlength=len(self._partition.regions))
        return nearest_possible(len(self._encoder.prepare(level).rows), there, self._budget) / len(regions)

    def encode(self, level: int | Level) -> Encoded:
        """Encode at a level.

        Raises:
            OptionError: as `choose`.
            FormatError: the avatar is not finite, or has values beyond what the format holds.
            HeadError: `head` is not the one that the avatar names.
        """
        chosen = level if isinstance(level, Level) else level_named(level)
        left = self._encoder.prepare_rows(chosen, self.choose(chosen).rows)
        return self._encoder.encode_prepared(left, drop_invisible=False)


def error_factors(scores: Scores, partition: Partition, budget: Budget) -> Float[np.ndarray, " n"]:
    """Give how many times as much an error counts at each Gaussian.

    It is 1 in the mean by score: to raise all weights alike is to raise none.

    Args:
        scores: of n Gaussians.
        partition: the head's regions.
        budget: with weights and importance.
    """
    triangle = np.ones(len(partition.labels)) if budget.importance is None else budget.importance.astype(np.float64)
    for label, weight in budget.weights.items():
        triangle = np.where(partition.labels == label, weight * triangle, triangle)
    factors = triangle[scores.gaussians.binding]
    total, weighed = scores.score.sum(), (scores.score * factors).sum()
    mean = weighed / total if total > 0 and weighed > 0 else 1.0
    clipped: np.ndarray = np.clip(factors / mean, 1 / MOST, MOST)
    return clipped
