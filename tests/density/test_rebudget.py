"""Another budget from scores: exact counts, orders and proportions that theorems give, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.density.budget import Budget
from sacha_core.density.events import Calibration
from sacha_core.density.rebudget import rebudget
from sacha_core.density.scores_file import BlendingSums, Scores
from sacha_core.errors import FormatError, OptionError
from sacha_core.regions.partition import Partition

N_REGIONS = 4
LABELS = np.arange(60, dtype=np.uint8) % N_REGIONS
REGIONS = Partition("paper", ("a", "b", "c", "d"), ((0, 0, 0),) * N_REGIONS, LABELS)


def scores_of(seed: int = 0, modulator: tuple[float | None, ...] = (1.0, 1.0, 1.0, 1.0)) -> Scores:
    """Give 60 Gaussians, 15 a region, with different scores."""
    rng = np.random.default_rng(seed)
    nothing = (None,) * N_REGIONS
    event = Calibration(
        7, (15,) * 4, (15,) * 4, nothing, nothing, nothing, None, None, None, modulator, (3e-4,) * 4, (0.2,) * 4, "plain"
    )  # fmt: skip
    gaussians = initial_gaussians(60, rng, 0)
    gaussians = replace(gaussians, sensitivity_logit=rng.normal(size=60).astype(np.float32))
    return Scores(gaussians, rng.exponential(size=60), 60, "paper", (event,))


@given(st.integers(1, 60), st.integers(0, 99))
def test_exactly_the_wanted_number_stays_and_nothing_that_goes_is_worth_more(count, seed) -> None:
    scores = scores_of(seed)
    found = rebudget(scores, REGIONS, Budget(count / 60))
    assert len(found.rows) == count
    gone = np.delete(scores.score, found.rows)
    assert gone.max(initial=0) <= scores.score[found.rows].min()
    assert sum(found.pruning.after) == count
    assert found.pruning.iteration == 7


@given(st.floats(0.02, 1), st.integers(0, 99))
def test_quotas_of_regions_are_floors_of_their_shares(keep, seed) -> None:
    scores = scores_of(seed, (0.5, 1.0, None, 1.9))
    found = rebudget(scores, REGIONS, Budget(keep, scope="regions"))
    ratios = np.minimum((1 - keep) * np.array([0.5, 1.0, 1.0, 1.9]), 1)
    assert found.pruning.removed == tuple(np.floor(15 * ratios + 1e-9).astype(int))


@given(st.floats(0.1, 10), st.integers(0, 99))
def test_a_weight_is_the_same_as_that_factor_on_the_scores_of_its_region(weight, seed) -> None:
    scores = scores_of(seed)
    found = rebudget(scores, REGIONS, Budget(0.5, {2: weight}))
    factor = np.where(LABELS == 2, weight, 1.0)
    same = rebudget(replace(scores, score=scores.score * factor), REGIONS, Budget(0.5))
    assert found.rows.tolist() == same.rows.tolist()


@given(st.integers(0, 99), st.floats(1, 50))
def test_more_weight_never_costs_a_region_a_gaussian(seed, weight) -> None:
    scores = scores_of(seed, (0.7, 1.4, 1.0, 0.9))
    plain = rebudget(scores, REGIONS, Budget(0.4))
    for scope in ("weighted", "regions"):
        before = rebudget(scores, REGIONS, Budget(0.4, scope=scope)).pruning.after[0]
        assert rebudget(scores, REGIONS, Budget(0.4, {0: weight}, scope=scope)).pruning.after[0] >= before
    assert len(plain.rows) == len(rebudget(scores, REGIONS, Budget(0.4, {0: weight})).rows)


def test_measurements_are_bounded_and_weights_are_not() -> None:
    found = rebudget(scores_of(0, (0.01, 9.0, 1.0, None)), REGIONS, Budget(0.5, {0: 4.0}, 0.5, 2.0))
    assert found.modulator.tolist() == [0.125, 2.0, 1.0, 1.0]


def test_without_a_calibration_the_sensitivities_speak() -> None:
    scores = replace(scores_of(), events=())
    logits = np.where(LABELS == 1, 0.0, -1.0986122886681098)  # sensitivities 1/2 and 1/4
    scores = replace(scores, gaussians=replace(scores.gaussians, sensitivity_logit=logits))
    found = rebudget(scores, REGIONS, Budget(0.5))
    assert found.modulator == pytest.approx([1.25, 0.625, 1.25, 1.25], rel=1e-12)


def test_what_no_view_shows_goes_first_whatever_its_region_is_worth() -> None:
    scores = scores_of()
    scores.score[LABELS == 3] = 0
    found = rebudget(scores, REGIONS, Budget(0.75, {3: 1000.0}))
    assert found.pruning.after == (15, 15, 15, 0)


@given(st.integers(1, 60), st.integers(0, 99), st.sampled_from(["weighted", "regions", "all"]))
def test_the_hidden_go_before_the_others_lowest_first_and_shares_are_of_what_remains(count, seed, scope) -> None:
    rng = np.random.default_rng(seed)
    scores = scores_of(seed, (0.6, 1.0, 1.7, 1.0))
    weight = np.where(rng.random(60) < 0.4, 0.5, 50.0)  # pixels over ten views
    scores = replace(scores, sums=BlendingSums(weight, weight / 2, 10))
    found = rebudget(scores, REGIONS, Budget(count / 60, scope=scope, visible_pixels=0.1))
    hidden, kept = weight < 1, np.isin(np.arange(60), found.rows)
    if hidden.sum() >= 60 - count:
        assert kept[~hidden].all()
        assert kept.sum() == count
        assert scores.score[hidden & ~kept].max(initial=0) <= scores.score[hidden & kept].min(initial=np.inf)
    else:
        assert not kept[hidden].any()
    if scope == "regions" and not kept[hidden].any():
        shown = np.bincount(LABELS[~hidden], minlength=N_REGIONS)
        ratios = np.minimum((shown.sum() - count) / shown.sum() * found.modulator, 1)
        assert found.pruning.after == tuple(shown - np.floor(shown * ratios + 1e-9).astype(int))


@given(st.floats(0, 3))
def test_a_power_acts_on_the_modulators_and_not_on_the_weights(power) -> None:
    found = rebudget(scores_of(0, (0.01, 9.0, 1.0, 0.8)), REGIONS, Budget(0.5, {0: 4.0}, power=power))
    assert found.modulator == pytest.approx([0.5**power / 4, 2.0**power, 1.0, 0.8**power], rel=1e-12)


def test_keeping_all_keeps_all() -> None:
    assert rebudget(scores_of(), REGIONS, Budget(1.0)).rows.tolist() == list(range(60))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"keep": 0.0}, "keep is 0"),
        ({"keep": 1.5}, "keep is 1.5"),
        ({"keep": float("nan")}, "keep is nan"),
        ({"keep": 0.5, "weights": {1: 0.0}}, "weight of region 1"),
        ({"keep": 0.5, "weights": {1: float("inf")}}, "weight of region 1"),
        ({"keep": 0.5, "lowest_modulator": 3.0}, "bounded by 3"),
        ({"keep": 0.5, "power": -1.0}, "power is -1"),
    ],
)
def test_a_budget_that_makes_no_sense_is_refused(options, message) -> None:
    with pytest.raises(OptionError, match=message):
        Budget(**options)


def test_scores_of_another_scheme_and_weights_of_no_region_are_refused() -> None:
    with pytest.raises(FormatError, match="4 regions, expected 5"):
        rebudget(scores_of(), replace(REGIONS, regions=(*REGIONS.regions, "e")), Budget(0.5))
    with pytest.raises(OptionError, match="region 4"):
        rebudget(scores_of(), REGIONS, Budget(0.5, {4: 2.0}))
    with pytest.raises(OptionError, match="leaves none"):
        rebudget(scores_of(), REGIONS, Budget(1e-300))


def test_other_regions_than_trainings_are_judged_by_their_own_gaussians() -> None:
    logits = np.where(LABELS == 1, 0.0, -1.0986122886681098)  # sensitivities 1/2 and 1/4
    scores = scores_of(0, (0.7, 1.4, 1.0, 0.9))  # calibrated, but by another scheme
    scores = replace(scores, gaussians=replace(scores.gaussians, sensitivity_logit=logits))
    found = rebudget(scores, replace(REGIONS, name="mine"), Budget(0.5))
    assert found.modulator == pytest.approx([1.25, 0.625, 1.25, 1.25], rel=1e-12)
    shown = np.where(LABELS == 0, 0.0, 50.0)  # the first region never shows: its sensitivities say nothing
    scores = replace(scores, sums=BlendingSums(shown, shown, 10))
    found = rebudget(scores, replace(REGIONS, name="mine"), Budget(0.5))
    assert found.modulator == pytest.approx([1, 2 / 3, 4 / 3, 4 / 3], rel=1e-12)


@given(st.integers(0, 99), st.sampled_from(["weighted", "all"]))
def test_painting_a_region_is_the_same_as_its_weight(seed, scope) -> None:
    scores = scores_of(seed, (0.7, 1.4, 1.0, 0.9))
    importance = np.where(LABELS == 2, 3.0, 1.0)
    painted = rebudget(scores, REGIONS, Budget(0.5, scope=scope, importance=importance))
    weighted = rebudget(scores, REGIONS, Budget(0.5, {2: 3.0}, scope=scope))
    assert painted.rows.tolist() == weighted.rows.tolist()


def test_painting_a_region_takes_less_of_it_where_each_loses_its_own_share() -> None:
    importance = np.where(LABELS == 2, 4.0, 1.0)
    found = rebudget(scores_of(), REGIONS, Budget(0.6, scope="regions", importance=importance))
    assert found.pruning.removed == (6, 6, 1, 6)  # floors of 0.4 of 15, and of a quarter of that


def test_what_is_painted_nought_goes_first_in_its_own_order() -> None:
    scores = scores_of()
    importance = np.where(LABELS == 1, 0.0, 1.0)
    found = rebudget(scores, REGIONS, Budget(5 / 6, importance=importance))
    assert found.pruning.after == (15, 5, 15, 15)
    of = np.flatnonzero(LABELS == 1)
    best = of[np.argsort(scores.score[of])[-5:]]
    assert sorted(best) == sorted(np.intersect1d(found.rows, of))
