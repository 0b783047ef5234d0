"""Laws of a run's prunings: powers of modulators, what never shows first, artists' weights."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.density.guard import guarded
from sacha_core.density.modulators import bounded
from sacha_core.density.selection import hidden_ones, lowest_of_all, lowest_of_each_region
from sacha_core.errors import OptionError
from sacha_core.train.density_control import calibrate
from sacha_core.train.importance import SeenWeights
from sacha_core.train.options import PruningOptions, TrainOptions
from sacha_core.train.presets import variant
from sacha_core.train.pruning import prune, remove_hidden
from sacha_core.train.regions import Regions
from sacha_core.train.state import TrainState, initial_state

FACES = 16
NAMES = ("mouth", "eyes", "nose", "face")
REGIONS = Regions((np.arange(FACES) // 4).astype(np.uint8), 4, NAMES)
VIEWS = 12  # of which each must show a pixel's twelfth, so that a summed weight of 1 is where showing begins
GUARDS = ("off", "exclude", "after")


def state_of(seed: int, n: int = 60) -> TrainState:
    """Give Gaussians on random triangles, with random sensitivities."""
    rng = np.random.default_rng(seed)
    gaussians = initial_gaussians(FACES, rng, 0).select(np.sort(rng.integers(0, FACES, n)))
    state = initial_state(gaussians, Motion.rest(0, 1, 2), 4, 3e-4, 0.2)
    state.values["sensitivity_logit"][:] = rng.normal(0, 1, n)
    state.values["position"][:, 0] = np.arange(n)  # tells who is who
    state.iteration = 110_000
    return state


def names_of(state: TrainState) -> set[int]:
    """Give who is there."""
    return set(state.values["position"][:, 0].astype(int))


def pruning(**changes) -> TrainOptions:
    """Give options of pruning."""
    return replace(TrainOptions(), pruning=PruningOptions(**changes))


@given(st.integers(0, 2**32), st.sampled_from(GUARDS))
def test_with_a_power_of_0_regions_do_not_matter(seed, guard) -> None:
    state, score = state_of(seed), np.random.default_rng(seed).exponential(size=60)
    state.ratios = np.array([0.1, 0.3, 0.2, 0.4])
    of = REGIONS.of(state.binding)
    expected = lowest_of_all(score, of, 4, 0.2, state.binding, guard)
    event = prune(state, pruning(scope="weighted", power=0.0, guard=guard), REGIONS, score)
    assert event.removed == tuple(expected.removed)
    assert names_of(state) == set(np.flatnonzero(~expected.remove))


@given(st.integers(0, 2**32), st.sampled_from([-1.0, 0.5, 1.0, 2.0]))
def test_scores_are_divided_by_a_power_of_the_modulator(seed, power) -> None:
    state, score = state_of(seed), np.random.default_rng(seed).exponential(size=60)
    modulator = np.array([0.5, 1.5, 1.0, 2.0])
    state.ratios = 0.2 * modulator
    divided = score / modulator[REGIONS.of(state.binding)] ** power
    prune(state, pruning(scope="weighted", power=power), REGIONS, score)
    assert names_of(state) == set(sorted(range(60), key=lambda i: divided[i])[12:])


@given(st.integers(0, 2**32), st.sampled_from(GUARDS), st.sampled_from(["none", "all", "weighted", "regions"]))
def test_what_never_shows_goes_first_and_the_ratio_is_of_the_rest(seed, guard, scope) -> None:
    rng = np.random.default_rng(seed)
    state, score = state_of(seed), rng.exponential(size=60)
    of, binding = REGIONS.of(state.binding), state.binding.copy()
    weights = np.stack([rng.choice([0.0, 0.9, 1.0, 1.1, 50.0], 60), np.zeros(60)], axis=1)
    hidden = weights[:, 0] <= 1.0
    event, kept = remove_hidden(state, pruning(guard=guard, scope=scope), REGIONS, SeenWeights(weights, VIEWS))
    assert event.requested == tuple(np.bincount(of[hidden], minlength=4))
    assert names_of(state) == set(kept)
    assert not set(np.flatnonzero(~hidden)) - set(kept)  # what shows stays
    if guard == "off":
        assert np.array_equal(kept, np.flatnonzero(~hidden))
        assert event.removed == event.requested
    else:
        assert set(binding[kept]) == set(binding)  # no triangle is emptied
    if guard == "after":
        assert np.array_equal(kept, np.flatnonzero(~guarded(hidden, binding)))
    if scope != "none":
        before = np.bincount(of[kept], minlength=4)
        second = prune(state, pruning(guard=guard, scope=scope), REGIONS, score[kept])
        assert second.before == event.after == tuple(before)
        if scope == "regions":
            assert second.requested == tuple(int(Fraction(1, 5) * int(count)) for count in before)
        else:
            assert sum(second.requested) == len(kept) // 5


@given(st.integers(0, 2**32), st.sampled_from(GUARDS))
def test_one_ratio_for_each_region_is_that_of_every_region(seed, guard) -> None:
    state, score = state_of(seed), np.random.default_rng(seed).exponential(size=60)
    state.ratios = np.array([0.1, 0.3, 0.2, 0.4])  # which do not matter
    expected = lowest_of_each_region(score, REGIONS.of(state.binding), np.full(4, 0.25), state.binding, guard)
    event = prune(state, pruning(scope="each", ratio=0.25, guard=guard), REGIONS, score)
    assert event.requested == tuple(int(Fraction(1, 4) * count) for count in event.before)
    assert names_of(state) == set(np.flatnonzero(~expected.remove))


@given(st.integers(0, 2**32), st.integers(0, 2**32), st.sampled_from(GUARDS))
def test_what_is_hidden_does_not_depend_on_the_order(seed, order, guard) -> None:
    rng = np.random.default_rng(seed)
    weight, binding = rng.permutation(40) / 4.0, rng.integers(0, FACES, 40)
    of, shuffled = REGIONS.of(binding), np.random.default_rng(order).permutation(40)
    one = hidden_ones(weight, 3.0, of, 4, binding, guard)
    other = hidden_ones(weight[shuffled], 3.0, of[shuffled], 4, binding[shuffled], guard)
    assert np.array_equal(one.remove[shuffled], other.remove)
    assert np.array_equal(one.removed, other.removed)


def test_weights_that_are_no_numbers_do_not_show() -> None:
    one = hidden_ones(np.array([np.nan, 2.0]), 1.0, np.array([0, 0]), 1, np.array([0, 1]))
    assert one.remove.tolist() == [True, False]


@given(st.integers(0, 2**32), st.floats(0.2, 5))
def test_an_artists_weight_divides_once_whatever_the_bounds(seed, weight) -> None:
    plain, steered = variant(TrainOptions(), "paper"), variant(TrainOptions(), "paper")
    steered = replace(steered, density=replace(steered.density, region_weights=(("eyes", weight),)))
    one, other = (calibrate(state_of(seed), made, REGIONS, None) for made in (plain, steered))
    measured, weights = np.array(one.modulator), np.array([1, weight, 1, 1])
    assert other.modulator == pytest.approx(tuple(measured / weights), rel=1e-15)
    assert other.threshold == pytest.approx(tuple(bounded(3e-4, measured, 1.5e-4, 6e-4) / weights), rel=1e-15)
    assert other.ratio == pytest.approx(tuple(np.minimum(bounded(0.2, measured, 0.1, 0.4) / weights, 1)), rel=1e-15)


def test_weights_of_regions_are_checked() -> None:
    with pytest.raises(OptionError, match=r"region_weights names 'eye', expected one of mouth, eyes, nose, face"):
        REGIONS.factors((("eye", 2.0),))
    for weight in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(OptionError, match="region_weights of eyes"):
            replace(TrainOptions(), density=replace(TrainOptions().density, region_weights=(("eyes", weight),)))


@given(st.integers(0, 2**32), st.sampled_from(["learned", "inverted", "random", "uniform"]))
def test_controls_reach_thresholds_and_ratios(seed, mode) -> None:
    learned, made = variant(TrainOptions(), "paper"), variant(TrainOptions(), "paper")
    made = replace(made, seed=5, density=replace(made.density, modulators=mode))
    plain = np.array(calibrate(state_of(seed), learned, REGIONS, None).modulator)
    state = state_of(seed)
    used = np.array(calibrate(state, made, REGIONS, None).modulator)
    if mode == "inverted":
        assert used == pytest.approx(1 / plain, rel=1e-15)
    elif mode == "random":
        assert np.array_equal(np.sort(used), np.sort(plain))
    else:
        assert np.array_equal(used, plain if mode == "learned" else np.ones(4))
    assert np.array_equal(state.thresholds, bounded(3e-4, used, 1.5e-4, 6e-4))


@given(st.integers(0, 2**32))
def test_by_region_exactly_the_floor_of_each_regions_ratio_goes(seed) -> None:
    """Of the whole chain: calibration, ratios with their bounds, selection."""
    state, made = state_of(seed), replace(variant(TrainOptions(), "paper"), pruning=PruningOptions(scope="regions"))
    calibrate(state, made, REGIONS, None)
    of, score = REGIONS.of(state.binding), np.random.default_rng(seed).integers(0, 9, 60).astype(float)
    expected = lowest_of_each_region(score, of, state.ratios, state.binding)
    event = prune(state, made, REGIONS, score)
    assert event.removed == tuple(expected.removed) == tuple(
        int(np.floor(ratio * count + 1e-9)) for ratio, count in zip(state.ratios, event.before, strict=True)
    )  # fmt: skip
    for region in range(4):  # ties go by index, lower first
        members = np.flatnonzero(of == region)
        gone = sorted(members, key=lambda i: (score[i], i))[: event.removed[region]]
        assert set(members) - names_of(state) == set(gone)


@pytest.mark.parametrize("name", ["default", "paper"])
def test_the_threshold_of_warm_up_ends_with_it(name) -> None:
    made = variant(TrainOptions(), name)
    made = replace(made, density=replace(made.density, threshold_in_warm_up=2e-4))
    state = state_of(0)
    state.thresholds[:] = 2e-4
    event = calibrate(state, made, REGIONS, None)
    assert state.thresholds == pytest.approx(
        bounded(3e-4, np.array(event.modulator), 1.5e-4, 6e-4) if name == "paper" else 3e-4
    )


def test_prunings_may_come_apart_from_calibrations_and_wait_for_opacities() -> None:
    schedule = replace(TrainOptions().schedule, prunings=(125_000, 135_000, 200_000))
    assert [schedule.prunes(moment) for moment in (110_000, 125_000, 135_000, 200_000)] == [False, False, True, True]
    assert schedule.last_pruning == 200_000
    assert replace(schedule, settling=0).prunes(125_000)
    assert replace(schedule, prunings=()).last_pruning is None
    assert replace(schedule, settling=10**6).last_pruning is None
