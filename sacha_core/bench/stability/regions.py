"""Hard cases of density control by region: regions with no Gaussian or one, with none in view, and numbers at their limits."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.bench.stability.case import Case, Findings
from sacha_core.density.events import Calibration, dump_events
from sacha_core.train import density_control as control
from sacha_core.train.densifying import densify
from sacha_core.train.importance import SeenWeights, importance
from sacha_core.train.options import TrainOptions
from sacha_core.train.presets import preset
from sacha_core.train.pruning import prune
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, initial_state

__all__ = ["cases"]

Change = dict[str, Any]  # what is unlike an ordinary run

F = np.float32
LARGEST = float(np.finfo(F).max)
N_REGIONS, FACES_OF_EACH = 8, 20
N_VIEWS = 10
VARIANTS = ("paper", "sacha", "rad-gp-lgs", "default-gp-pis")
EXTENT_M, LOCAL_UNIT_M = 1.5, 0.005

SANE = "go through every event: finite thresholds and ratios within their bounds, exact counts, finite parameters"

# Gaussians of each region
CENSUS = {
    "a region without Gaussians": (40, 40, 0, 40, 40, 40, 40, 40),
    "a region with one Gaussian": (40, 40, 1, 40, 40, 40, 40, 40),
    "one region has all": (0, 0, 300, 0, 0, 0, 0, 0),
    "one Gaussian in all": (0, 0, 1, 0, 0, 0, 0, 0),
    "no Gaussian at all": (0,) * 8,
}
EVEN = (40,) * 8
LOGITS = {"all as insensitive as can be": -LARGEST, "all as sensitive as can be": LARGEST, "all alike": 0.3}
ATTRIBUTES = {
    "log-scales +80": ("log_scale", 80.0),
    "log-scales -80": ("log_scale", -80.0),
    "log-scales beyond all bounds": ("log_scale", LARGEST),
    "opacity logits +100": ("opacity_logit", 100.0),
    "opacity logits -100": ("opacity_logit", -100.0),
    "quaternions zero": ("quaternion", 0.0),
}
STATISTICS = {"gradients not a number": np.nan, "gradients infinite": np.inf, "gradients largest": LARGEST}


def cases(full: bool = False) -> Iterator[Case]:  # noqa: ARG001 (there is nothing to look closer at)
    """Give the family."""
    for name, census in CENSUS.items():
        yield Case(name, f"Gaussians by region: {', '.join(map(str, census))}", SANE, partial(_all_events, census, {}))
    for name, seen in (("a region out of sight", 7 / 8), ("nothing in sight", 0.0)):
        yield Case(name, "training views show none of its Gaussians", SANE, partial(_all_events, EVEN, {"seen": seen}))
    for name, logit in LOGITS.items():
        neutral = f"{SANE}; every modulator exactly 1"
        yield Case(
            f"sensitivities {name}", f"logits {logit:.3g}", neutral, partial(_all_events, EVEN, {"sensitivity": logit})
        )
    yield Case(
        "one region insensitive", "its logits -100, the others' 0", SANE, partial(_all_events, EVEN, {"one": -100.0})
    )
    for name, attribute in ATTRIBUTES.items():
        yield Case(name, "of every other Gaussian", SANE, partial(_all_events, EVEN, {"attribute": attribute}))
    for name, value in STATISTICS.items():
        yield Case(
            name,
            "of every other Gaussian since the last growth",
            SANE,
            partial(_all_events, EVEN, {"statistic": value}),
        )


def _all_events(census: tuple[int, ...], change: Change, findings: Findings) -> None:
    for variant in VARIANTS:
        for means in ("plain", "visible", "weighted"):
            options = preset(variant)
            options = replace(options, density=replace(options.density, means=means))
            _events(census, change, options, findings)


def _events(census: tuple[int, ...], change: Change, options: TrainOptions, findings: Findings) -> None:
    """Calibrate, score, prune, grow and reset, as a run does."""
    regions = Regions(np.repeat(np.arange(N_REGIONS), FACES_OF_EACH).astype(np.uint8), N_REGIONS)
    state, seen = _state(census, change), _seen(census, change)
    calibration = control.calibrate(state, options, regions, seen)
    _hold_calibration(calibration, options, change, findings)
    score = importance(state, options, seen, np.full(N_REGIONS * FACES_OF_EACH, LOCAL_UNIT_M))
    findings.require(bool((score >= 0).all()), "scores not negative")
    pruning = prune(state, options, regions, score)
    left = tuple(b - r for b, r in zip(pruning.before, pruning.removed, strict=True))
    findings.require(pruning.after == left == regions.counts(state.binding), "counts agree")
    growth = densify(state, options, regions, np.full(N_REGIONS * FACES_OF_EACH, LOCAL_UNIT_M), EXTENT_M)
    parts = zip(growth.before, growth.cloned, growth.split, growth.removed, strict=True)
    findings.require(growth.after == tuple(b + c + s - r for b, c, s, r in parts), "counts agree")
    control.reset_opacity(state, options)
    n = len(state)
    findings.require(all(len(state.values[name]) == n for name in ("position", "sh_rest", "log_scale")), "counts agree")
    untouched = {"log_scale"} if "attribute" in change else set()
    findings.finite("parameters", {name: value for name, value in state.values.items() if name not in untouched})
    json.loads(dump_events([calibration]), parse_constant=_no_constant)


def _hold_calibration(calibration: Calibration, options: TrainOptions, change: Change, findings: Findings) -> None:
    density, pruning = options.density, options.pruning
    modulator = np.array(calibration.modulator, float)
    findings.require(bool((modulator > 0).all() and np.isfinite(modulator).all()), "modulators above 0")
    if "sensitivity" in change:
        findings.require(bool((modulator == 1).all()), "every modulator exactly 1")
    if density.by_region:
        threshold = np.array(calibration.threshold, float)
        inside = (threshold >= density.threshold_lowest) & (threshold <= density.threshold_highest)
        findings.require(bool(inside.all()), "thresholds in bounds")
    if pruning.scope in {"regions", "weighted"}:
        ratio = np.array(calibration.ratio, float)
        findings.require(
            bool(((ratio >= pruning.ratio_lowest) & (ratio <= pruning.ratio_highest)).all()), "ratios in bounds"
        )


def _state(census: tuple[int, ...], change: Change) -> TrainState:
    rng = np.random.default_rng(9)
    of = _regions_of(census)
    n = len(of)
    gaussians = Gaussians(
        position=rng.normal(0, 0.3, (n, 3)).astype(F),
        log_scale=rng.normal(0, 0.5, (n, 3)).astype(F),
        quaternion=rng.normal(0, 1, (n, 4)).astype(F),
        opacity_logit=rng.normal(0, 2, n).astype(F),
        sh_dc=rng.normal(0, 1, (n, 3)).astype(F),
        sh_rest=np.zeros((n, 3, 3), F),
        binding=(FACES_OF_EACH * of + rng.integers(0, FACES_OF_EACH, n)).astype(np.int32),
        sensitivity_logit=rng.normal(0, 1, n).astype(F),
    )
    gaussians = gaussians.select(np.argsort(gaussians.binding, kind="stable"))
    state = initial_state(gaussians, Motion.rest(0, 0), N_REGIONS, 3e-4, 0.2)
    state.iteration = 120_000
    state.gradient_sum[:], state.gradient_count[:] = rng.exponential(3e-3, n), 10
    if "sensitivity" in change:
        state.values["sensitivity_logit"][:] = change["sensitivity"]
    if "one" in change:
        state.values["sensitivity_logit"][:] = np.where(of == 2, change["one"], 0)
    if "attribute" in change:
        name, value = change["attribute"]
        state.values[name][::2] = value
    if "statistic" in change:
        state.gradient_sum[::2] = change["statistic"]
    return state


def _seen(census: tuple[int, ...], change: Change) -> SeenWeights:
    """Weights of every Gaussian; none in region 2 where one is out of sight, none at all where nothing is in sight."""
    of = _regions_of(census)
    weights = np.random.default_rng(10).exponential(20, (len(of), 2)) * [1, 0.3]
    if "seen" in change:
        weights[(of == 2) | (change["seen"] == 0)] = 0
    return SeenWeights(weights, N_VIEWS, {"removal": np.tile(weights / 20, 2)})  # what changes shows and is no larger


def _regions_of(census: tuple[int, ...]) -> Int[np.ndarray, " n"]:
    """Region of each Gaussian; ascending, as they lie by triangle."""
    return np.repeat(np.arange(N_REGIONS), census)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} in an event")
