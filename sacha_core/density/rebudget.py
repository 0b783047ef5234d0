"""Another budget for an avatar that has scores: which of its Gaussians to keep, region by region, without training."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.budget import Budget
from sacha_core.density.events import Calibration, Pruning
from sacha_core.density.limits import best_within, limits_of, require_possible
from sacha_core.density.modulators import modulators
from sacha_core.density.region_means import region_means
from sacha_core.density.scores_file import Scores
from sacha_core.density.selection import Selection, lowest_of_all, lowest_of_each_region, quota
from sacha_core.errors import FormatError, OptionError
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import SCHEMES

__all__ = ["Rebudget", "rebudget"]

LEAST_IMPORTANCE = 1e-12


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


def rebudget(scores: Scores, partition: Partition, budget: Budget) -> Rebudget:
    """Choose the Gaussians that a smaller avatar keeps: the same pruning as in training, at another ratio, with an artist's say.

    What no view shows goes first. Ties go by index, the lower first.

    Args:
        scores: of every Gaussian.
        partition: the head's regions. Where they are others than training had, the sensitivities of their own Gaussians say what they need.
        budget: what is wanted.

    Raises:
        OptionError: something is said of no region, shares and locks leave no way to the budget, or nothing would be left.
        FormatError: the events are of another scheme.

    Source: SACHA, region-adaptive pruning; weights, shares, locks, painted importance and the common ranking are our own.
    """
    n_regions = len(partition.regions)
    require_regions(budget, partition)
    regions = partition.labels[scores.gaussians.binding]
    modulator = _modulator(scores, regions, partition, budget)
    hidden = _hidden(scores, budget)
    if budget.shares or budget.locks:
        remove, requested = _within_limits(scores, regions, modulator, hidden, partition, budget)
    else:
        remove, requested = _by_quota(scores, regions, modulator, hidden, budget)
    rows = np.flatnonzero(~remove)
    if not len(rows):
        raise OptionError(f"keep {budget.keep:g} of {len(hidden)} Gaussians leaves none, expected more")
    before, after = (np.bincount(regions[of], minlength=n_regions) for of in (slice(None), rows))
    counts = (tuple(of.tolist()) for of in (before, requested, before - after, after))
    return Rebudget(rows, modulator, Pruning(_iteration(scores), "stored", "off", *counts))


def require_regions(budget: Budget, partition: Partition) -> None:
    """Check that a budget speaks of regions and triangles that there are.

    Raises:
        OptionError: it does not.
    """
    n_regions = len(partition.regions)
    for what, told in (("a weight", budget.weights), ("a share", budget.shares), ("a lock", budget.locks)):
        if stray := sorted(label for label in told if not 0 <= label < n_regions):
            raise OptionError(f"{what} is for region {stray[0]}, expected 0 to {n_regions - 1}")
    if budget.importance is not None and len(budget.importance) != len(partition.labels):
        raise OptionError(
            f"importance is given for {len(budget.importance)} triangles, but the head has {len(partition.labels)}"
        )


def worth(
    scores: Scores, regions: Integer[np.ndarray, " n"], modulator: Float[np.ndarray, " r"], budget: Budget
) -> Float[np.ndarray, " n"]:
    """Give what the common ranking goes by: the score, times what is painted, over the modulator of the region."""
    return np.asarray(painted(scores, budget) / modulator[regions])


def painted(scores: Scores, budget: Budget) -> Float[np.ndarray, " n"]:
    """Give scores times the importance of their triangles; what is painted 0 goes before all else that shows, in its own order."""
    if budget.importance is None:
        return scores.score
    factors = np.maximum(budget.importance, LEAST_IMPORTANCE)
    return np.asarray(scores.score * factors[scores.gaussians.binding])


def _by_quota(
    scores: Scores,
    regions: Integer[np.ndarray, " n"],
    modulator: Float[np.ndarray, " r"],
    hidden: Bool[np.ndarray, " n"],
    budget: Budget,
) -> tuple[Bool[np.ndarray, " n"], Int[np.ndarray, " r"]]:
    """Mark what goes: the hidden, then a share of the others; and give what was asked of each region."""
    wanted = (1 - budget.keep) * len(hidden)  # removals
    among, shown = np.flatnonzero(hidden), np.flatnonzero(~hidden)
    first = among[np.argsort(scores.score[among], kind="stable")[: quota(len(hidden), 1 - budget.keep)]]
    ratio = max(wanted - len(first), 0.0) / len(shown) if len(first) == len(among) and len(shown) else 0.0
    chosen = _lowest(scores, regions, modulator, shown, ratio, budget)
    remove = np.zeros(len(hidden), bool)
    remove[first] = remove[shown[chosen.remove]] = True
    return remove, np.bincount(regions[first], minlength=len(modulator)) + chosen.requested


def _within_limits(
    scores: Scores,
    regions: Integer[np.ndarray, " n"],
    modulator: Float[np.ndarray, " r"],
    hidden: Bool[np.ndarray, " n"],
    partition: Partition,
    budget: Budget,
) -> tuple[Bool[np.ndarray, " n"], Int[np.ndarray, " r"]]:
    """Mark what goes where regions have shares and locks; and give what goes of each region."""
    n_kept = len(hidden) - quota(len(hidden), 1 - budget.keep)
    there = np.bincount(regions, minlength=len(modulator))
    limits = limits_of(np.array([n_kept]), there, budget)
    require_possible(limits, partition.regions, budget)
    ranking = np.where(hidden, scores.score, worth(scores, regions, modulator, budget))
    order = np.lexsort((np.arange(len(hidden)), ranking, ~hidden))
    remove = ~best_within(order, regions, limits)
    return remove, np.bincount(regions[remove], minlength=len(modulator))


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
    score, of, binding = painted(scores, budget)[rows], regions[rows], scores.gaussians.binding[rows]
    if budget.scope == "regions":
        factors = modulator / _mean_importance(of, binding, len(modulator), budget)
        return lowest_of_each_region(score, of, np.clip(ratio * factors, 0, 1), binding)
    return lowest_of_all(score / modulator[of], of, len(modulator), ratio, binding)


def _mean_importance(
    regions: Integer[np.ndarray, " n"], binding: Int[np.ndarray, " n"], n_regions: int, budget: Budget
) -> Float[np.ndarray, " r"]:
    """Give the mean of what is painted over each region's Gaussians; 1 where there are none, and never 0."""
    if budget.importance is None:
        return np.ones(n_regions)
    sums = np.bincount(regions, budget.importance[binding], n_regions)
    counts = np.bincount(regions, minlength=n_regions)
    mean = np.divide(sums, counts, out=np.ones(n_regions), where=counts > 0)
    return np.maximum(mean, LEAST_IMPORTANCE)


def _modulator(
    scores: Scores, regions: Integer[np.ndarray, " n"], partition: Partition, budget: Budget
) -> Float[np.ndarray, " r"]:
    """Give the last calibration's modulators, or, where there was none, those of the sensitivities; bounded, and over the weights."""
    n_regions = len(partition.regions)
    measured = np.ones(n_regions)
    if budget.scope != "all":
        measured = _measured(scores, regions, partition, budget)
    weights = np.array([budget.weights.get(label, 1.0) for label in range(n_regions)])
    of: np.ndarray = np.clip(measured, budget.lowest_modulator, budget.highest_modulator) ** budget.power / weights
    return of


def _measured(
    scores: Scores, regions: Integer[np.ndarray, " n"], partition: Partition, budget: Budget
) -> Float[np.ndarray, " r"]:
    n_regions = len(partition.regions)
    calibrations = [event for event in scores.events if isinstance(event, Calibration)]
    known_scheme = partition.name == scores.scheme and partition.name in SCHEMES  # one's own may have changed since
    if calibrations and known_scheme:
        known = calibrations[-1].modulator
        if len(known) != n_regions:
            raise FormatError(f"the scores' events are of {len(known)} regions, expected {n_regions}")
        return np.array([1.0 if value is None else value for value in known])
    logits = scores.gaussians.sensitivity_logit
    if logits is None:
        return np.ones(n_regions)
    counted = None
    if scores.sums is not None and not known_scheme:
        counted = scores.sums.visible(budget.visible_pixels)  # what never shows has learned nothing
    return modulators(region_means(sigmoid(logits.astype(np.float64)), regions, n_regions, counted))


def _iteration(scores: Scores) -> int:
    return max((event.iteration for event in scores.events), default=0)
