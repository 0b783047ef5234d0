"""Shares and locks: the best set that they allow, by trying all; exact counts; and what stands in the way of a budget, in words."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.density.budget import Budget
from sacha_core.density.limits import best_within, limits_of, nearest_possible
from sacha_core.density.rebudget import rebudget
from sacha_core.density.scores_file import BlendingSums, Scores
from sacha_core.errors import OptionError
from sacha_core.regions.partition import Partition

N = 60
LABELS = np.repeat(np.arange(4, dtype=np.uint8), (6, 12, 18, 24))
REGIONS = Partition("paper", ("mouth", "eyes", "nose", "face"), ((0, 0, 0),) * 4, LABELS)


def scores_of(seed: int = 0) -> Scores:
    """Give 60 Gaussians, one a triangle, with different scores."""
    rng = np.random.default_rng(seed)
    gaussians = replace(initial_gaussians(N, rng, 0), sensitivity_logit=np.zeros(N, np.float32))
    return Scores(gaussians, rng.exponential(size=N), N, "paper")


def by_trying(ranks: np.ndarray, regions: np.ndarray, lowest: np.ndarray, highest: np.ndarray, total: int) -> set[int]:
    """Give the best set: the one whose worst differing member ranks highest, by trying every vector of counts."""
    members = [np.flatnonzero(regions == r)[np.argsort(-ranks[regions == r])] for r in range(len(lowest))]
    ranges = [range(low, high + 1) for low, high in zip(lowest, highest, strict=True)]
    vectors = [counts for counts in product(*ranges) if sum(counts) == total]
    sets = [{int(row) for own, k in zip(members, counts, strict=True) for row in own[:k]} for counts in vectors]
    return max(sets, key=lambda rows: sum(2 ** int(ranks[row]) for row in rows))


@given(st.integers(0, 500))
def test_the_choice_is_the_best_that_the_limits_allow(seed) -> None:
    rng = np.random.default_rng(seed)
    n, total = 12, int(rng.integers(1, 12))
    regions, ranks = rng.integers(0, 3, n), rng.permutation(n)
    low, high = sorted(rng.random(2).tolist())
    budget = Budget(1.0, shares={0: (low / 2, high)}, locks={1: int(rng.integers(0, 4))})
    limits = limits_of(np.array([total]), np.bincount(regions, minlength=3), budget)
    if not limits.possible[0]:
        return
    keep = best_within(np.argsort(ranks), regions, limits)
    assert set(np.flatnonzero(keep).tolist()) == by_trying(ranks, regions, limits.lowest[0], limits.highest[0], total)


@given(st.integers(1, N), st.integers(0, 99), st.sampled_from(["weighted", "all"]))
def test_limits_that_limit_nothing_change_nothing(count, seed, scope) -> None:
    rng = np.random.default_rng(seed)
    weight = np.where(rng.random(N) < 0.3, 0.5, 50.0)
    scores = replace(scores_of(seed), sums=BlendingSums(weight, weight, 10))
    free = Budget(count / N, {1: 3.0}, scope=scope)
    limited = replace(free, shares=dict.fromkeys(range(4), (0.0, 1.0)))
    assert rebudget(scores, REGIONS, limited).rows.tolist() == rebudget(scores, REGIONS, free).rows.tolist()


def test_shares_and_locks_hold_to_the_gaussian() -> None:
    scores = scores_of()
    scores.score[LABELS == 0] = 1e-3  # the mouth would lose nearly all
    for count in range(20, 36, 5):  # more would fill up with the mouth
        budget = Budget(count / N, shares={0: (0.1, 0.3), 3: (0.0, 0.25)}, locks={1: 7})
        found = rebudget(scores, REGIONS, budget)
        mouth, eyes, _, face = found.pruning.after
        assert sum(found.pruning.after) == count
        assert mouth == np.ceil(0.1 * count - 1e-9)
        assert eyes == 7
        assert face <= 0.25 * count


def test_a_lock_without_a_number_keeps_all_even_what_never_shows() -> None:
    weight = np.where(LABELS == 1, 0.0, 50.0)
    scores = replace(scores_of(), sums=BlendingSums(weight, weight, 10))
    assert rebudget(scores, REGIONS, Budget(0.5, locks={1: None})).pruning.after[1] == 12


@given(st.integers(1, N), st.floats(0, 0.5), st.floats(0.5, 1), st.integers(0, 30))
def test_the_nearest_possible_number_is_possible_and_none_is_nearer(wanted, low, high, locked) -> None:
    there, budget = np.bincount(LABELS), Budget(1.0, shares={0: (low, high)}, locks={3: locked})
    every = np.arange(1, N + 1)
    possible = every[limits_of(every, there, budget).possible]
    if not len(possible):
        with pytest.raises(OptionError, match="no number of Gaussians"):
            nearest_possible(wanted, there, budget)
        return
    found = nearest_possible(wanted, there, budget)
    assert found in possible
    assert abs(found - wanted) == np.abs(possible - wanted).min()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"shares": {0: (0.5, 1.0)}}, "mouth has 6 Gaussians, and a share of 0.5 of 30 is 15"),
        (
            {"shares": {0: (0.01, 0.02)}},
            "no number of Gaussians is 0.01 to 0.02 of 30; expected wider bounds for mouth",
        ),
        ({"locks": {2: None, 3: 20}}, "ask for 38 Gaussians, but 30 shall stay"),
        ({"shares": {2: (0.0, 0.1), 3: (0.0, 0.1)}}, "allow for 24 Gaussians, but 30 shall stay"),
        ({"shares": {0: (0.4, 0.3)}}, "0.4 to 0.3"),
        ({"shares": {0: (0.0, 1.5)}}, "0 to 1.5"),
        ({"shares": {0: (float("nan"), 1.0)}}, "nan"),
        ({"shares": {4: (0.0, 1.0)}}, "a share is for region 4"),
        ({"locks": {-1: None}}, "a lock is for region -1"),
        ({"locks": {0: -1}}, "locked to -1"),
        ({"locks": {0: None}, "scope": "regions"}, "share of its own"),
        ({"importance": np.ones(59)}, "59 triangles, but the head has 60"),
        ({"importance": np.full(60, -1.0)}, "negative or not finite"),
        ({"importance": np.full(60, np.nan)}, "negative or not finite"),
    ],
)
def test_what_cannot_be_kept_to_is_refused(limits, message) -> None:
    with pytest.raises(OptionError, match=message):
        rebudget(scores_of(), REGIONS, Budget(0.5, **limits))
