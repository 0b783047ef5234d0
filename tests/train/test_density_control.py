"""Calibration, pruning, densification and resets on states made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.growth import shared_opacity
from sacha_core.density.selection import lowest_of_all
from sacha_core.train.densifying import densify
from sacha_core.train.density_control import calibrate, reset_opacity
from sacha_core.train.importance import SeenWeights, importance
from sacha_core.train.options import PruningOptions, TrainOptions
from sacha_core.train.presets import preset, variant
from sacha_core.train.pruning import prune
from sacha_core.train.regions import Regions
from sacha_core.train.state import ATTRIBUTES, TrainState, initial_state

FACES = 16
REGIONS = Regions((np.arange(FACES) // 4).astype(np.uint8), 4)
EXTENT_M = 1.0
LAST_DIGIT = 2e-4  # both sides are rounded to four digits, one of them from float32
SIZES_M = np.full(FACES, 0.005, np.float32)  # at most 0.01 of the extent: cloned


def state_of(n_per_face: int = 2, seed: int = 0) -> TrainState:
    """Give Gaussians of random attributes, with moments that are not 0."""
    rng = np.random.default_rng(seed)
    gaussians = initial_gaussians(FACES, rng, 1).select(np.repeat(np.arange(FACES), n_per_face))
    state = initial_state(gaussians, Motion.rest(0, 1, 2), 4, 3e-4, 0.2)
    for name in ATTRIBUTES:
        state.values[name][:] = rng.normal(0, 0.3, state.values[name].shape)
        state.first[name][:] = 1
        state.second[name][:] = 2
    state.iteration = 200_000
    return state


def options(**density) -> TrainOptions:
    made = preset("sacha")
    return replace(made, density=replace(made.density, **density))


def test_the_opacity_prune_follows_the_guard() -> None:
    state = state_of()
    state.values["opacity_logit"][:6] = -9  # all of faces 0, 1, 2
    state.values["opacity_logit"][7] = -9  # one of face 3's
    guarded = densify(state, options(guard_faint=True), REGIONS, SIZES_M, EXTENT_M)
    assert guarded.removed == (1, 0, 0, 0)
    off = densify(state, options(guard_faint=False), REGIONS, SIZES_M, EXTENT_M)
    assert off.removed == (6, 0, 0, 0)
    assert off.after == (1, 8, 8, 8)


def test_in_warm_up_the_guard_always_holds() -> None:
    state = state_of()
    state.iteration = 20_000
    state.values["opacity_logit"][:] = -9
    assert densify(state, options(guard_faint=False), REGIONS, SIZES_M, EXTENT_M).removed == (0, 0, 0, 0)


def test_a_clone_is_its_parent_with_fresh_moments() -> None:
    state = state_of()
    before = {name: state.values[name].copy() for name in ATTRIBUTES}
    state.gradient_sum[3], state.gradient_count[3] = 1.0, 2
    state.values["log_scale"][3] = 0
    before["log_scale"][3] = 0
    event = densify(state, options(), REGIONS, SIZES_M, EXTENT_M)
    assert (event.cloned, event.split) == ((1, 0, 0, 0), (0, 0, 0, 0))
    assert state.binding[2:5].tolist() == [1, 1, 1]
    for name in ATTRIBUTES:
        assert np.array_equal(state.values[name][3], before[name][3])
        assert np.array_equal(state.values[name][4], before[name][3])
        assert (state.first[name][4] == 0).all()
        assert (state.first[name][:4] == 1).all()
        assert (state.second[name][4] == 0).all()
    assert not state.gradient_sum.any()
    assert not state.gradient_count.any()


def test_a_clone_may_share_its_parents_opacity() -> None:
    state, copied = state_of(), state_of()
    for one in (state, copied):
        one.gradient_sum[3], one.gradient_count[3] = 1.0, 2
        one.values["log_scale"][3] = 0
    logit = state.values["opacity_logit"][3:4].copy()
    densify(state, options(clone_opacity="shared"), REGIONS, SIZES_M, EXTENT_M)
    densify(copied, options(), REGIONS, SIZES_M, EXTENT_M)
    assert np.array_equal(state.values["opacity_logit"][3:5], np.repeat(shared_opacity(logit), 2))
    others = np.delete(state.values["opacity_logit"], [3, 4])
    assert np.array_equal(others, np.delete(copied.values["opacity_logit"], [3, 4]))


def test_a_split_replaces_its_parent_by_two_smaller_ones_close_by() -> None:
    state = state_of()
    sizes = SIZES_M.copy()
    sizes[1] = 0.05  # too large to be cloned
    state.values["log_scale"][3] = 0
    parent = {name: state.values[name][3].copy() for name in ATTRIBUTES}
    state.gradient_sum[3], state.gradient_count[3] = 1.0, 1
    event = densify(state, options(), REGIONS, sizes, EXTENT_M)
    assert (event.cloned, event.split) == ((0, 0, 0, 0), (1, 0, 0, 0))
    children = slice(3, 5)
    assert state.binding[2:5].tolist() == [1, 1, 1]
    assert np.allclose(state.values["log_scale"][children], np.log(1 / 1.6), atol=1e-6)
    assert not np.array_equal(state.values["position"][3], state.values["position"][4])
    # offsets are drawn with 0.05 m and added to local units: six deviations
    assert np.abs(state.values["position"][children] - parent["position"]).max() < 6 * 0.05
    for name in set(ATTRIBUTES) - {"position", "log_scale"}:
        assert (state.values[name][children] == parent[name]).all()
    for name in ATTRIBUTES:
        assert not state.first[name][children].any()
        assert not state.second[name][children].any()
        assert (np.delete(state.second[name], children, axis=0) == 2).all()


def grown_step_by_step(state: TrainState, made: TrainOptions) -> list[tuple[float, ...]]:
    """Do as the method says, one Gaussian after the other: clones, then splits on the longer list, then the prune by opacity.

    Gives the attributes of those that stay but for the places of children, which are drawn.
    """
    rows = []
    for i in range(len(state)):
        row = {name: np.atleast_1d(state.values[name][i]).ravel().astype(np.float64) for name in ATTRIBUTES}
        count = max(int(state.gradient_count[i]), 1)
        rows.append((int(state.binding[i]), float(state.gradient_sum[i]) / count, row))

    def longest(face: int, row: dict) -> float:
        return float(np.exp(row["log_scale"].astype(np.float32)).max() * SIZES_M[face])

    def grows(face: int, gradient: float) -> bool:
        return gradient >= state.thresholds[REGIONS.labels[face]]

    limit = made.density.largest_clone * EXTENT_M
    rows += [(f, 0.0, row) for f, g, row in rows if grows(f, g) and longest(f, row) <= limit]
    parents = [k for k, (f, g, row) in enumerate(rows) if grows(f, g) and longest(f, row) > limit]
    for k in parents:
        face, _, row = rows[k]
        child = {**row, "log_scale": np.log(np.exp(row["log_scale"]) / (0.8 * 2))}
        rows += [(face, 0.0, child), (face, 0.0, child)]
    rows = [row for k, row in enumerate(rows) if k not in parents]
    faint = [1 / (1 + np.exp(-row["opacity_logit"][0])) < 0.005 for _, _, row in rows]
    spared = {f for f, _, _ in rows} - {f for (f, _, _), gone in zip(rows, faint, strict=True) if not gone}
    names = [name for name in ATTRIBUTES if name != "position"]
    kept = [(f, row) for (f, _, row), gone in zip(rows, faint, strict=True) if not gone or f in spared]
    return sorted((f, *np.concatenate([row[name] for name in names]).round(4)) for f, row in kept)


@given(st.integers(0, 2**32))
def test_growth_is_that_of_the_method_step_by_step(seed) -> None:
    rng = np.random.default_rng(seed)
    state = state_of(3, seed)
    state.values["opacity_logit"][:] = rng.choice([-5.31, -5.28, 1], len(state))  # 0.0049 and 0.0051
    state.values["log_scale"][:] = rng.normal(0.5, 0.5, (len(state), 3))
    state.gradient_sum[:] = rng.choice([0, 3e-4, 9e-4, 2e-3], len(state))
    state.gradient_count[:] = rng.integers(0, 4, len(state))
    state.gradient_sum[state.gradient_count == 0] = 0
    state.thresholds = rng.choice([1.4e-4, 2.9e-4, 6.1e-4], 4)
    made = options(guard_faint=True)
    expected = grown_step_by_step(state, made)
    densify(state, made, REGIONS, SIZES_M, EXTENT_M)
    names = [name for name in ATTRIBUTES if name != "position"]
    found = np.concatenate([state.values[name].reshape(len(state), -1) for name in names], axis=1).astype(np.float64)
    rows = sorted((int(f), *row) for f, row in zip(state.binding, found.round(4), strict=True))
    assert len(rows) == len(expected)
    assert np.abs(np.array(rows) - np.array(expected)).max() < LAST_DIGIT


def test_pruning_keeps_moments_and_statistics_of_those_that_stay() -> None:
    state = state_of()
    n = len(state)
    state.gradient_sum[:], state.gradient_count[:] = np.arange(n), np.arange(n) + 1
    for name in ATTRIBUTES:
        state.first[name][:] = np.arange(n).reshape((n, *[1] * (state.first[name].ndim - 1)))
    score = np.random.default_rng(0).permutation(n).astype(float)
    prune(state, variant(TrainOptions(), "default-gp-pis"), REGIONS, score)
    stay = np.flatnonzero(score >= int(0.2 * n))
    assert np.array_equal(state.gradient_sum, stay)
    assert np.array_equal(state.gradient_count, stay + 1)
    assert np.array_equal(state.first["opacity_logit"], stay)


def test_the_far_too_large_go_only_after_their_time() -> None:
    for iteration, expected in ((50_000, 0), (70_000, 1)):
        state = state_of()
        state.iteration = iteration
        state.values["log_scale"][5] = np.log(0.11 * EXTENT_M / SIZES_M[0])
        assert sum(densify(state, options(), REGIONS, SIZES_M, EXTENT_M).removed) == expected


def test_regions_grow_by_their_own_thresholds() -> None:
    state = state_of()
    state.values["log_scale"][:] = 0
    state.gradient_sum[:], state.gradient_count[:] = 4e-4, 1
    state.thresholds = np.array([3e-4, 5e-4, 4e-4, 6e-4])
    event = densify(state, options(), REGIONS, SIZES_M, EXTENT_M)
    assert event.cloned == tuple(8 if np.float32(4e-4) >= t else 0 for t in state.thresholds)


def test_nothing_is_densified_from_nothing() -> None:
    state = state_of(0)
    assert densify(state, options(), REGIONS, SIZES_M, EXTENT_M).after == (0, 0, 0, 0)


def test_calibration_sets_what_the_formulas_say() -> None:
    state = state_of()
    a = np.array([0.2, 0.4, 0.8, 0.2])[REGIONS.of(state.binding)]
    state.values["sensitivity_logit"] = np.log(a / (1 - a)).astype(np.float32)
    weights = np.zeros((len(state), 2))
    weights[::2, 0], weights[1::2, 0] = 10.1, 9.9  # 10 pixels in 120 views are what counts
    event = calibrate(state, variant(TrainOptions(), "paper"), REGIONS, SeenWeights(weights, 120))
    assert event.modulator == pytest.approx((2.0, 1.0, 0.5, 2.0), rel=1e-6)  # the logits are float32
    assert state.thresholds == pytest.approx([6e-4, 3e-4, 1.5e-4, 6e-4], rel=1e-6)
    assert state.ratios == pytest.approx([0.4, 0.2, 0.1, 0.4], rel=1e-6)
    assert event.visible_counts == (4, 4, 4, 4)
    assert event.mean_visible == pytest.approx((0.2, 0.4, 0.8, 0.2), rel=1e-6)


def test_default_is_not_touched_by_calibration() -> None:
    state = state_of()
    event = calibrate(state, variant(TrainOptions(), "default"), REGIONS, None)
    assert event.threshold == (3e-4,) * 4
    assert event.ratio == (0.0,) * 4
    assert event.mean_visible == (None,) * 4


def test_a_region_without_gaussians_and_one_with_a_single_one_are_calibrated_and_pruned() -> None:
    state = state_of(1)
    keep = np.flatnonzero((REGIONS.of(state.binding) > 1) | (state.binding == 4))
    for name in ATTRIBUTES:
        state.values[name], state.first[name], state.second[name] = (
            kind[name][keep] for kind in (state.values, state.first, state.second)
        )
    state.binding = state.binding[keep]
    state.gradient_sum, state.gradient_count = state.gradient_sum[keep], state.gradient_count[keep]
    chosen = variant(TrainOptions(), "paper")
    event = calibrate(state, chosen, REGIONS, SeenWeights(np.ones((len(state), 2)), 1))
    assert event.counts == (0, 1, 4, 4)
    assert event.modulator[0] == 1.0
    assert event.mean_plain[0] is None
    pruned = prune(state, chosen, REGIONS, np.arange(len(keep), dtype=float))
    assert pruned.requested[:2] == (0, 0)
    assert len(state) == sum(pruned.after)


@given(st.integers(0, 2**32))
def test_weighted_pruning_without_modulation_is_global_pruning(seed) -> None:
    state = state_of(3, seed % 100)
    score = np.random.default_rng(seed).exponential(size=len(state))
    chosen = replace(TrainOptions(), pruning=PruningOptions(scope="weighted"))
    expected = lowest_of_all(score, REGIONS.of(state.binding), 4, 0.2, state.binding)
    assert prune(state, chosen, REGIONS, score).removed == tuple(expected.removed.tolist())


def test_weighted_pruning_spares_sensitive_regions_and_takes_what_is_never_seen_anywhere() -> None:
    state = state_of(5)
    of = REGIONS.of(state.binding)
    state.ratios = np.array([0.1, 0.4, 0.2, 0.2])  # region 0 sensitive, region 1 not
    score = np.random.default_rng(0).uniform(1, 2, len(state))
    hidden = np.flatnonzero(of == 0)[:3]
    score[hidden] = 0
    chosen = replace(TrainOptions(), pruning=PruningOptions(scope="weighted"))
    event = prune(state, chosen, REGIONS, score)
    assert sum(event.removed) == len(of) // 5
    assert event.removed[0] == 3
    assert event.removed[1] > event.removed[2]


def test_importance_in_metres_prefers_large_triangles() -> None:
    state = state_of(1)
    state.values["log_scale"][:] = 0
    state.values["sensitivity_logit"][:] = 0
    seen = SeenWeights(np.ones((len(state), 2)), 1)
    sizes = np.linspace(0.001, 0.02, FACES).astype(np.float32)
    chosen = preset("rad-gp-pis")
    local = importance(state, chosen, seen, sizes)
    assert len(set(local)) == 1
    world = importance(state, replace(chosen, importance=replace(chosen.importance, volume_space="world")), seen, sizes)
    assert (np.diff(world) >= 0).all()
    assert world[0] < world[-1]


def test_a_reset_lowers_opacities_and_forgets_their_moments_only() -> None:
    state = state_of()
    state.values["opacity_logit"][0] = -8
    event = reset_opacity(state, options())
    opacity = 1 / (1 + np.exp(-state.values["opacity_logit"].astype(float)))
    assert opacity.max() == pytest.approx(0.01, rel=1e-6)
    assert opacity[0] < 0.001
    assert event.lowered == len(state) - 1
    assert not state.first["opacity_logit"].any()
    assert not state.second["opacity_logit"].any()
    assert state.first["position"].all()


@pytest.mark.parametrize("guard", [False, True])
def test_what_has_no_end_goes_at_the_next_densification_even_the_last_of_its_triangle(guard) -> None:
    state = state_of()
    state.iteration = 20_000  # neither is the size looked at yet, nor is a last one let go
    state.values["log_scale"][[0, 1, 5], 1] = 90  # beyond float32's exp
    state.gradient_sum[:6], state.gradient_count[:6] = 1.0, 1
    event = densify(state, options(guard_faint=guard), REGIONS, SIZES_M, EXTENT_M)
    assert event.removed == (3, 0, 0, 0)
    assert not (state.binding == 0).any()
    assert all(np.isfinite(value).all() for value in state.values.values())
