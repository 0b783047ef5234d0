"""Another budget for an avatar that has scores: which of its Gaussians to keep, region by region, without training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.events import Calibration, Pruning
from sacha_core.density.modulators import modulators
from sacha_core.density.region_means import region_means
from sacha_core.density.scores_file import Scores
from sacha_core.density.selection import Selection, lowest_of_all, lowest_of_each_region, quota
from sacha_core.errors import FormatError, OptionError

__all__ = ["Budget", "Rebudget", "rebudget"]


@dataclass(frozen=True)
class Budget:
    """What an avatar shall be cut down to.

    Args:
        keep: share of the Gaussians that stays, above 0 and at most 1.
        weights: by the label of a region, how much more it is worth than measured; 1 where none is given. A weight of 2 acts as half the
            modulator: each score of the region counts twice, or the region loses half its share.
        lowest_modulator: of any region, before weights. The bounds keep a measurement from starving or feeding a region beyond reason; an
            artist's weight is not bounded by them.
        highest_modulator: likewise.
        scope: `weighted` ranks all Gaussians together, by score over the modulator of the region; `regions` takes from each region its
            own share, the common one times the modulator; `all` ranks by score alone, so that modulators count for nothing and weights do.
        power: that bounded modulators are raised to, before weights.
        visible_pixels: blending weight, in pixels a view, up to which a Gaussian counts as hidden: those go first, lowest scores before
            others, wherever they are, and shares of regions are of what remains. Where a file does not say what views showed, those
            of score 0.
    """

    keep: float
    weights: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    lowest_modulator: float = 0.5
    highest_modulator: float = 2.0
    scope: Literal["weighted", "regions", "all"] = "weighted"
    power: float = 1.0
    visible_pixels: float = 1 / 12

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        if not 0 < self.keep <= 1:
            raise OptionError(f"keep is {self.keep:g}, expected above 0 and at most 1")
        if not 0 < self.lowest_modulator <= self.highest_modulator < np.inf:
            raise OptionError(
                f"modulators are bounded by {self.lowest_modulator:g} and {self.highest_modulator:g}, expected 0 < lowest <= highest"
            )
        if not 0 <= self.power < np.inf:
            raise OptionError(f"power is {self.power:g}, expected 0 or more")
        for label, weight in self.weights.items():
            if not 0 < weight < np.inf:
                raise OptionError(f"the weight of region {label} is {weight:g}, expected above 0")


@dataclass(frozen=True)
class Rebudget:
    """What stays.

    Args:
        rows: (m,) which of the scored Gaussians stay, ascending.
        modulator: (r,) of each region, bounded, over its weight.
        pruning: counts before and after, by region.
    """

    rows: Int[np.ndarray, " m"]
    modulator: Float[np.ndarray, " r"]
    pruning: Pruning


def rebudget(scores: Scores, labels: Integer[np.ndarray, " f"], n_regions: int, budget: Budget) -> Rebudget:
    """Choose the Gaussians that a smaller avatar keeps: the same pruning as in training, at another ratio, with an artist's say.

    What no view shows goes first. Ties go by index, the lower first.

    Args:
        scores: of every Gaussian.
        labels: (f,) region of each triangle of the head.
        n_regions: of the scheme.
        budget: what is wanted.

    Raises:
        OptionError: a weight names no region, or nothing would be left.
        FormatError: the events are of another scheme.

    Source: SACHA, region-adaptive pruning; weights and the common ranking are our own.
    """
    if stray := sorted(label for label in budget.weights if not 0 <= label < n_regions):
        raise OptionError(f"a weight is for region {stray[0]}, expected 0 to {n_regions - 1}")
    regions = labels[scores.gaussians.binding]
    modulator = _modulator(scores, regions, n_regions, budget)
    hidden = _hidden(scores, budget)
    wanted = (1 - budget.keep) * len(hidden)  # removals
    among, shown = np.flatnonzero(hidden), np.flatnonzero(~hidden)
    first = among[np.argsort(scores.score[among], kind="stable")[: quota(len(hidden), 1 - budget.keep)]]
    ratio = max(wanted - len(first), 0.0) / len(shown) if len(first) == len(among) and len(shown) else 0.0
    chosen = _lowest(scores, regions, modulator, shown, ratio, budget)
    remove = np.zeros(len(hidden), bool)
    remove[first] = remove[shown[chosen.remove]] = True
    rows = np.flatnonzero(~remove)
    if not len(rows):
        raise OptionError(f"keep {budget.keep:g} of {len(hidden)} Gaussians leaves none, expected more")
    before, after, early = (np.bincount(regions[of], minlength=n_regions) for of in (slice(None), rows, first))
    counts = (tuple(of.tolist()) for of in (before, early + chosen.requested, before - after, after))
    return Rebudget(rows, modulator, Pruning(_iteration(scores), "stored", "off", *counts))


def _hidden(scores: Scores, budget: Budget) -> Bool[np.ndarray, " n"]:
    hidden: np.ndarray = scores.score == 0
    if scores.sums is not None:
        hidden = ~scores.sums.visible(budget.visible_pixels)
    return hidden


def _lowest(
    scores: Scores,
    regions: Integer[np.ndarray, " n"],
    modulator: Float[np.ndarray, " r"],
    rows: Int[np.ndarray, " m"],
    ratio: float,
    budget: Budget,
) -> Selection:
    """Select a share of some of the Gaussians."""
    score, of, binding = scores.score[rows], regions[rows], scores.gaussians.binding[rows]
    if budget.scope == "regions":
        return lowest_of_each_region(score, of, np.clip(ratio * modulator, 0, 1), binding)
    return lowest_of_all(score / modulator[of], of, len(modulator), ratio, binding)


def _modulator(
    scores: Scores, regions: Integer[np.ndarray, " n"], n_regions: int, budget: Budget
) -> Float[np.ndarray, " r"]:
    """Give the last calibration's modulators, or, where there was none, those of the sensitivities; bounded, and over the weights."""
    measured = np.ones(n_regions)
    if budget.scope != "all":
        measured = _measured(scores, regions, n_regions)
    weights = np.array([budget.weights.get(label, 1.0) for label in range(n_regions)])
    of: np.ndarray = np.clip(measured, budget.lowest_modulator, budget.highest_modulator) ** budget.power / weights
    return of


def _measured(scores: Scores, regions: Integer[np.ndarray, " n"], n_regions: int) -> Float[np.ndarray, " r"]:
    calibrations = [event for event in scores.events if isinstance(event, Calibration)]
    if calibrations:
        known = calibrations[-1].modulator
        if len(known) != n_regions:
            raise FormatError(f"the scores' events are of {len(known)} regions, expected {n_regions}")
        return np.array([1.0 if value is None else value for value in known])
    logits = scores.gaussians.sensitivity_logit
    if logits is None:
        return np.ones(n_regions)
    return modulators(region_means(sigmoid(logits.astype(np.float64)), regions, n_regions))


def _iteration(scores: Scores) -> int:
    return max((event.iteration for event in scores.events), default=0)
