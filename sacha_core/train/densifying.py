"""Densification of a run: who is cloned, split, or removed for being nearly transparent or far too large."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.events import Densification
from sacha_core.density.growth import CHILDREN, growth, shared_opacity, split_children
from sacha_core.density.guard import guarded
from sacha_core.train.importance import spreads
from sacha_core.train.options import TrainOptions
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, rearrange

__all__ = ["densify"]


def densify(
    state: TrainState, options: TrainOptions, regions: Regions, triangle_scale: Float[np.ndarray, " f"], extent: float
) -> Densification:
    """Clone, split, and remove the nearly transparent and the far too large; statistics start anew.

    Args:
        state: changed.
        options: of the run.
        regions: of the head.
        triangle_scale: (f,) metres a local unit, in the pose of this iteration.
        extent: of the scene, metres.

    Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 5.2; GaussianAvatars, CVPR 2024, section 3.3.
    """
    density, values, n = options.density, state.values, len(state)
    of, before = regions.of(state.binding), regions.counts(state.binding)
    size = triangle_scale[state.binding]
    gradient = state.gradient_sum / np.maximum(state.gradient_count, 1)
    scales = spreads(values["log_scale"]) * size[:, None]
    grown = growth(gradient, state.thresholds[of], scales, density.largest_clone * extent)
    parents = np.flatnonzero(grown.split)
    rng = np.random.default_rng([options.seed, state.iteration, 2])
    local = (values["position"][parents], values["log_scale"][parents], values["quaternion"][parents])
    places, sizes = split_children(*local, size[parents], rng, density.spread)
    kept = np.concatenate([np.flatnonzero(~grown.split), np.flatnonzero(grown.clone)])
    rows = np.concatenate([kept, np.tile(parents, CHILDREN)])
    fresh = np.arange(len(rows)) >= n - len(parents)
    replaced = {
        "position": np.concatenate([values["position"][kept], places]),
        "log_scale": np.concatenate([values["log_scale"][kept], sizes]),
    }
    if density.clone_opacity == "shared":
        opacity = values["opacity_logit"].copy()
        opacity[grown.clone] = shared_opacity(opacity[grown.clone])
        replaced["opacity_logit"] = opacity[rows]
    remove = superfluous(state, options, rows, spreads(replaced["log_scale"]) * size[rows, None], extent)
    keep = ~remove
    rearrange(state, rows[keep], fresh[keep], {name: value[keep] for name, value in replaced.items()})
    state.gradient_sum[:] = 0
    state.gradient_count[:] = 0
    r = regions.n_regions
    return Densification(
        iteration=state.iteration,
        before=before,
        cloned=tuple(np.bincount(of[grown.clone], minlength=r).tolist()),
        split=tuple(np.bincount(of[grown.split], minlength=r).tolist()),
        removed=tuple(np.bincount(of[rows[remove]], minlength=r).tolist()),
        after=regions.counts(state.binding),
    )


def superfluous(
    state: TrainState, options: TrainOptions, rows: np.ndarray, scales: Float[np.ndarray, "m 3"], extent: float
) -> Bool[np.ndarray, " m"]:
    """Mark rows that are nearly transparent or far too large, but for a triangle's last where those are guarded; and all without end."""
    density, schedule = options.density, options.schedule
    remove: np.ndarray = sigmoid(state.values["opacity_logit"])[rows] < density.lowest_opacity
    if state.iteration > schedule.size_prune_from:
        remove |= scales.max(axis=1, initial=0) > density.largest * extent
    if density.guard_faint or state.iteration < schedule.warm_up:
        remove = guarded(remove, state.binding[rows])
    remove |= ~np.isfinite(scales).all(axis=1)  # which is never drawn, and so never learns to be smaller
    return remove
