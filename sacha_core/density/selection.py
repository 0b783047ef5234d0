"""Which Gaussians to prune: the lowest scores of all, or of each region by its quota."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from sacha_core.density.guard import guarded

__all__ = ["Guard", "Selection", "hidden_ones", "lowest_of_all", "lowest_of_each_region", "quota"]

Guard = Literal["off", "exclude", "after"]


@dataclass(frozen=True)
class Selection:
    """What pruning by score asks for, and what it gets.

    Args:
        remove: (n,) what goes.
        requested: (r,) removals asked for in each region.
        removed: (r,) removals made; fewer where the guard forbids some.
    """

    remove: Bool[np.ndarray, " n"]
    requested: Int[np.ndarray, " r"]
    removed: Int[np.ndarray, " r"]


def quota(count: int, ratio: float) -> int:
    """Give floor(ratio * count), of the numbers as people write them: 0.29 of 100 is 29, though 0.29 is a little less in binary."""
    return int(np.floor(ratio * count + 1e-9))


def lowest_of_each_region(
    score: Float[np.ndarray, " n"],
    regions: Integer[np.ndarray, " n"],
    ratios: Float[np.ndarray, " r"],
    binding: Int[np.ndarray, " n"],
    guard: Guard = "off",
) -> Selection:
    """Select the floor(ratio count) lowest scores of each region; no region pays for another.

    Args:
        score: (n,) importance; ties go by index, lower first.
        regions: (n,) region of each Gaussian.
        ratios: (r,) share of each region that shall go, 0 to 1.
        binding: (n,) triangle of each Gaussian.
        guard: `off` takes all that the quota asks for; `exclude` fills it from those that are not the best of their triangle; `after`
            fills it from all, then spares triangles that would be left empty.

    Source: SACHA, region-adaptive pruning; guard: GaussianAvatars (`after`), our own (`exclude`).
    """
    order = np.argsort(score, kind="stable")
    candidate = ~best_of_triangle(order, binding) if guard == "exclude" else np.ones(len(score), bool)
    asked = np.zeros(len(score), bool)
    requested = np.zeros(len(ratios), np.int64)
    for region, ratio in enumerate(ratios):
        members = order[regions[order] == region]
        requested[region] = quota(len(members), float(ratio))
        asked[members[candidate[members]][: requested[region]]] = True
    return _selection(asked, requested, regions, binding, guard)


def lowest_of_all(
    score: Float[np.ndarray, " n"],
    regions: Integer[np.ndarray, " n"],
    n_regions: int,
    ratio: float,
    binding: Int[np.ndarray, " n"],
    guard: Guard = "off",
) -> Selection:
    """Select the floor(ratio n) lowest scores of all Gaussians; regions matter to the counts only.

    Args:
        score: (n,) importance; ties go by index, lower first.
        regions: (n,) region of each Gaussian.
        n_regions: number of regions.
        ratio: share that shall go, 0 to 1.
        binding: (n,) triangle of each Gaussian.
        guard: as for `lowest_of_each_region`.

    Source: Fan et al., LightGaussian, 2023 (global pruning).
    """
    order = np.argsort(score, kind="stable")
    lowest = order[: quota(len(score), ratio)]
    requested = np.bincount(regions[lowest], minlength=n_regions)
    candidates = order[~best_of_triangle(order, binding)[order]] if guard == "exclude" else order
    asked = np.zeros(len(score), bool)
    asked[candidates[: len(lowest)]] = True
    return _selection(asked, requested, regions, binding, guard)


def hidden_ones(
    weight: Float[np.ndarray, " n"],
    visible_from: float,
    regions: Integer[np.ndarray, " n"],
    n_regions: int,
    binding: Int[np.ndarray, " n"],
    guard: Guard = "off",
) -> Selection:
    """Select all Gaussians that never show.

    Args:
        weight: (n,) blending weight summed over pixels and views.
        visible_from: weight above which a Gaussian shows.
        regions: (n,) region of each Gaussian.
        n_regions: number of regions.
        binding: (n,) triangle of each Gaussian.
        guard: `off` takes all; `exclude` leaves a triangle on which nothing shows the one that shows most; `after` leaves it all.

    Source: own.
    """
    hidden = ~(weight > visible_from)
    requested = np.bincount(regions[hidden], minlength=n_regions)
    if guard == "exclude":
        hidden &= ~best_of_triangle(np.argsort(weight, kind="stable"), binding)
    return _selection(hidden, requested, regions, binding, guard)


def best_of_triangle(order: Int[np.ndarray, " n"], binding: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Mark the best Gaussian of each triangle: the last of its own in `order`."""
    best = np.zeros(len(order), bool)
    backwards = order[::-1]
    _, first = np.unique(binding[backwards], return_index=True)
    best[backwards[first]] = True
    return best


def _selection(
    asked: Bool[np.ndarray, " n"],
    requested: Int[np.ndarray, " r"],
    regions: Integer[np.ndarray, " n"],
    binding: Int[np.ndarray, " n"],
    guard: Guard,
) -> Selection:
    remove = guarded(asked, binding) if guard == "after" else asked
    return Selection(remove, requested, np.bincount(regions[remove], minlength=len(requested)))
