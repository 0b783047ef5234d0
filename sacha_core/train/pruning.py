"""Pruning of a run: what scores lowest, and what never shows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.density.events import HiddenRemoval, Pruning
from sacha_core.density.selection import hidden_ones, lowest_of_all, lowest_of_each_region
from sacha_core.train.importance import SeenWeights
from sacha_core.train.options import TrainOptions
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, rearrange

__all__ = ["prune", "remove_hidden"]


def prune(state: TrainState, options: TrainOptions, regions: Regions, score: Float[np.ndarray, " n"]) -> Pruning:
    """Remove the lowest scores, and let the statistics and moments of the others stand.

    Args:
        state: changed.
        options: of the run.
        regions: of the head.
        score: (n,) importance.
    """
    of, before, pruning = regions.of(state.binding), regions.counts(state.binding), options.pruning
    if pruning.scope in {"regions", "each"}:
        ratios = state.ratios if pruning.scope == "regions" else np.full(regions.n_regions, pruning.ratio)
        chosen = lowest_of_each_region(score, of, ratios, state.binding, pruning.guard)
    else:
        if pruning.scope == "weighted":
            score = score * ((pruning.ratio / state.ratios) ** pruning.power)[of]
        chosen = lowest_of_all(score, of, regions.n_regions, pruning.ratio, state.binding, pruning.guard)
    rearrange(state, np.flatnonzero(~chosen.remove))
    return Pruning(
        iteration=state.iteration,
        score=pruning.score,
        guard=pruning.guard,
        before=before,
        requested=tuple(chosen.requested.tolist()),
        removed=tuple(chosen.removed.tolist()),
        after=regions.counts(state.binding),
    )


def remove_hidden(
    state: TrainState, options: TrainOptions, regions: Regions, seen: SeenWeights
) -> tuple[HiddenRemoval, Int[np.ndarray, " m"]]:
    """Remove what never shows.

    Args:
        state: changed.
        options: of the run.
        regions: of the head.
        seen: what views show of each Gaussian.

    Returns:
        The event, and the m rows that stay, as they were numbered before.
    """
    of, before, guard = regions.of(state.binding), regions.counts(state.binding), options.pruning.guard
    pixels = options.importance.visible_pixels
    visible_from = pixels * seen.n_views
    chosen = hidden_ones(seen.weights[:, 0], visible_from, of, regions.n_regions, state.binding, guard)
    kept = np.flatnonzero(~chosen.remove)
    rearrange(state, kept)
    event = HiddenRemoval(
        iteration=state.iteration,
        guard=guard,
        n_views=seen.n_views,
        visible_pixels=pixels,
        before=before,
        requested=tuple(chosen.requested.tolist()),
        removed=tuple(chosen.removed.tolist()),
        after=regions.counts(state.binding),
    )
    return event, kept
