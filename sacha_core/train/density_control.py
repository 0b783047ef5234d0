"""Density control of a run but for growth and pruning: calibration and opacity resets, each with its event."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.events import Calibration, OpacityReset
from sacha_core.density.modulators import bounded, controlled, modulators
from sacha_core.density.region_means import RegionMeans, region_means
from sacha_core.train.importance import SeenWeights
from sacha_core.train.options import TrainOptions
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState

__all__ = ["calibrate", "reset_opacity"]


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
        visible = seen.sums().visible(options.importance.visible_pixels)
        means["visible"] = region_means(sensitivity, of, r, visible)
        means["weighted"] = region_means(sensitivity, of, r, seen.weights[:, 0])
        visible_counts = np.bincount(of[visible], minlength=r)
    density, pruning = options.density, options.pruning
    learned = modulators(means[density.means])
    measured, weights = controlled(learned, density.modulators, options.seed), regions.factors(density.region_weights)
    if density.by_region:
        bounds = (density.threshold_lowest, density.threshold_highest)
        state.thresholds = bounded(density.threshold, measured, *bounds) / weights
    else:
        state.thresholds = np.full(r, density.threshold)
    if pruning.scope in {"regions", "weighted"}:
        ratios = bounded(pruning.ratio, measured, pruning.ratio_lowest, pruning.ratio_highest) / weights
        state.ratios = np.minimum(ratios, 1)
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
        modulator=numbers(measured / weights),
        threshold=numbers(state.thresholds),
        ratio=numbers(state.ratios),
        used=density.means,
    )


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
