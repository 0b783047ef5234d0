"""Density control of a run: calibration, pruning by score, densification and opacity resets, each with its event."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.events import Calibration, Densification, OpacityReset, Pruning
from sacha_core.density.growth import CHILDREN, growth, split_children
from sacha_core.density.guard import guarded
from sacha_core.density.modulators import bounded, modulators
from sacha_core.density.region_means import RegionMeans, region_means
from sacha_core.density.scores.light_gaussian import light_gaussian_score
from sacha_core.density.scores.perceptual import perceptual_score
from sacha_core.density.scores.rounding import rounded
from sacha_core.density.selection import lowest_of_all, lowest_of_each_region
from sacha_core.train.options import TrainOptions
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, rearrange

__all__ = ["SeenWeights", "calibrate", "densify", "importance", "prune", "reset_opacity"]


@dataclass(frozen=True)
class SeenWeights:
    """What an importance pass found.

    Args:
        weights: (n, 2) float64 blending weight summed over pixels and views: plain, and weighted by reference sensitivity.
        n_views: number of views.
    """

    weights: Float[np.ndarray, "n 2"]
    n_views: int


def calibrate(state: TrainState, options: TrainOptions, regions: Regions, seen: SeenWeights | None) -> Calibration:
    """Measure the regions, and set their thresholds and ratios.

    Args:
        state: changed: thresholds and ratios.
        options: of the run.
        regions: of the head.
        seen: weights by which Gaussians are visible; None leaves those means out.
    """
    of, r = regions.of(state.binding), regions.n_regions
    sensitivity = sigmoid(state.values["sensitivity_logit"].astype(np.float64))
    means: dict[str, RegionMeans] = {"plain": region_means(sensitivity, of, r)}
    visible_counts = np.zeros(r, int)
    if seen is not None:
        visible = seen.weights[:, 0] > options.importance.visible_pixels * seen.n_views
        means["visible"] = region_means(sensitivity, of, r, visible)
        means["weighted"] = region_means(sensitivity, of, r, seen.weights[:, 0])
        visible_counts = np.bincount(of[visible], minlength=r)
    density, pruning = options.density, options.pruning
    modulator = modulators(means[density.means])
    if density.by_region:
        bounds = (density.threshold_lowest, density.threshold_highest)
        state.thresholds = bounded(density.threshold, modulator, *bounds)
    if pruning.scope in {"regions", "weighted"}:
        state.ratios = bounded(pruning.ratio, modulator, pruning.ratio_lowest, pruning.ratio_highest)
    elif pruning.scope == "none":
        state.ratios = np.zeros(r)
    region = {
        name: numbers(means[name].region) if name in means else (None,) * r for name in ("plain", "visible", "weighted")
    }
    overall = {name: numbers(np.array([means[name].overall]))[0] if name in means else None for name in region}
    return Calibration(
        iteration=state.iteration,
        counts=regions.counts(state.binding),
        visible_counts=tuple(visible_counts.tolist()),
        mean_plain=region["plain"],
        mean_visible=region["visible"],
        mean_weighted=region["weighted"],
        overall_plain=overall["plain"],
        overall_visible=overall["visible"],
        overall_weighted=overall["weighted"],
        modulator=numbers(modulator),
        threshold=numbers(state.thresholds),
        ratio=numbers(state.ratios),
        used=density.means,
    )


def importance(
    state: TrainState, options: TrainOptions, seen: SeenWeights, rest_scale: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " n"]:
    """Score every Gaussian, rounded to six digits.

    Args:
        state: of the Gaussians.
        options: of the run.
        seen: their weights.
        rest_scale: (f,) metres a local unit of each triangle of the neutral head.
    """
    scales = spreads(state.values["log_scale"].astype(np.float64))
    if options.importance.volume_space == "world":
        scales *= rest_scale[state.binding, None]
    plain, sensitive = seen.weights[:, 0], seen.weights[:, 1]
    if options.pruning.score == "lgs":
        return rounded(light_gaussian_score(plain, scales))
    sensitivity = sigmoid(state.values["sensitivity_logit"].astype(np.float64))
    factors = (options.importance.pixel_factor, options.importance.gaussian_factor)
    return rounded(perceptual_score(plain, sensitive, sensitivity, scales, *factors))


def prune(state: TrainState, options: TrainOptions, regions: Regions, score: Float[np.ndarray, " n"]) -> Pruning:
    """Remove the lowest scores, and let the statistics and moments of the others stand.

    Args:
        state: changed.
        options: of the run.
        regions: of the head.
        score: (n,) importance.
    """
    of, before, pruning = regions.of(state.binding), regions.counts(state.binding), options.pruning
    if pruning.scope == "regions":
        chosen = lowest_of_each_region(score, of, state.ratios, state.binding, pruning.guard)
    else:
        if pruning.scope == "weighted":
            score = score * (pruning.ratio / state.ratios)[of]
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


def spreads(log_scale: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Give standard deviations in local units, infinite where the dtype cannot hold them."""
    with np.errstate(over="ignore"):
        spread: np.ndarray = np.exp(log_scale)
    return spread


def reset_opacity(state: TrainState, options: TrainOptions) -> OpacityReset:
    """Bring opacities down to the ceiling, and forget their moments."""
    ceiling = options.density.reset_opacity
    logit = np.float32(np.log(ceiling / (1 - ceiling)))
    opacity = state.values["opacity_logit"]
    lowered = int(np.count_nonzero(opacity > logit))
    np.minimum(opacity, logit, out=opacity)
    state.first["opacity_logit"][:] = 0
    state.second["opacity_logit"][:] = 0
    return OpacityReset(state.iteration, ceiling, lowered)


def numbers(values: Float[np.ndarray, " r"]) -> tuple[float | None, ...]:
    """Give an array as plain numbers, None for what is not finite."""
    return tuple(float(value) if np.isfinite(value) else None for value in values)
