"""What an encoder decides from what numbers are worth: Gaussians and attributes are evened out, and a level keeps its meaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_avatars import random_avatar, small_head

from sacha_core.codec import decode, encode
from sacha_core.codec.allocation import FINER, N_CLASSES, hidden_classes
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.plan import BETTER, as_costly, even_out
from sacha_core.codec.steps import MAX_EXPONENT, MAX_HIDDEN, PER_OCTAVE, StepRule

N = 600


def importance_for(n: int, k: int, seed: int = 0) -> GaussianImportance:
    rng = np.random.default_rng(seed)
    seen = 4.0 ** rng.normal(0, 1.5, n)  # what all numbers of a Gaussian share
    found = {
        name: seen.reshape((n,) + (1,) * len(tail)) * rng.exponential(1.0, (n, *tail))
        for name, tail in (
            ("position", (3,)), ("log_scale", (3,)), ("rotation", (3,)), ("opacity", ()), ("sh_dc", (3,)), ("sh_rest", (k, 3)),
        )
    }  # fmt: skip
    return GaussianImportance(**found)


def test_hidden_classes_even_out_what_gaussians_cost():
    """Oracle: costs that differ by whole octaves of steps about the middle one become the same."""
    octaves = np.repeat(np.arange(N_CLASSES) - FINER, 100)
    octaves = np.concatenate([octaves, -octaves])  # classes stay within their range, the mean is none
    octaves = octaves[(octaves >= -FINER) & (octaves < N_CLASSES - FINER)]
    octaves = np.concatenate([octaves, np.full(max(-octaves.sum(), 0), 1), np.full(max(octaves.sum(), 0), -1)])
    classes = hidden_classes(3.0 * 4.0 ** -octaves.astype(float))
    assert np.array_equal(classes - FINER, octaves)


@given(st.lists(st.floats(0, 1e12), min_size=1, max_size=40))
def test_classes_rise_as_cost_falls_and_stay_in_range(costs):
    classes = hidden_classes(np.array(costs))
    assert classes.min() >= 0
    assert classes.max() < N_CLASSES <= MAX_HIDDEN + 1
    assert (np.diff(classes[np.argsort(costs)]) <= 0).all()


def test_attributes_are_evened_out_half_way():
    """Oracle: means of roots an octave from the middle one move by half an octave towards it."""
    roots = {"a": np.full((5, 1), 2.0), "position": np.ones((5, 3)), "b": np.full((5, 1), 0.5)}
    assert even_out(roots) == {"a": [-PER_OCTAVE // 2], "position": [0, 0, 0], "b": [PER_OCTAVE // 2]}


@pytest.mark.parametrize("finer", [0.0, 1.0])
def test_a_common_shift_makes_up_for_what_all_others_do_to_the_cost(finer):
    """Oracle: the sum of costs; shifts are rounded to an eighth of an octave."""
    rng = np.random.default_rng(4)
    costs = {"a": rng.exponential(1.0, (N, 2)), "b": rng.exponential(5.0, (N, 1))}
    coarser = 2.0 ** (rng.integers(-1, 2, (N, 1)) - finer)
    wanted, shifts = as_costly(costs, coarser, {"a": [3, -2], "b": [0]}), {"a": [3, -2], "b": [0]}
    lift = wanted["b"][0]
    assert wanted == {name: [shift + lift for shift in shifts[name]] for name in shifts}
    after = sum((costs[name] * coarser**2 * 4.0 ** (np.array(wanted[name]) / PER_OCTAVE)).sum() for name in costs)
    before = sum(cost.sum() for cost in costs.values())
    assert abs(np.log2(after / before) / 2 + BETTER) <= 0.5 / PER_OCTAVE + 1e-9


@given(st.integers(-300, 300), st.integers(0, 8))
def test_moved_rules_stay_in_the_table(exponent, hidden):
    rule = replace(StepRule(1, 2, 3, 0, -12, 48, 100), hidden=hidden).moved(exponent)
    assert rule.base + rule.low >= 0
    assert rule.base + rule.most <= MAX_EXPONENT
    if 12 <= 100 + exponent <= MAX_EXPONENT - 48 - MAX_HIDDEN * hidden:
        assert rule.base == 100 + exponent


@pytest.mark.parametrize("level", [1, 4])
@pytest.mark.parametrize("with_head", [False, True])
def test_what_is_worth_more_comes_back_closer(level, with_head):
    head = small_head()
    avatar = random_avatar(N, n_harmonics=3, head=head)
    n = len(avatar.gaussians)
    importance = importance_for(n, 3)
    given_head = head if with_head else None
    data = encode(avatar, level, head=given_head, importance=importance, drop_invisible=False)
    back = decode(data, head=given_head).gaussians
    assert data == encode(avatar, level, head=given_head, importance=importance, drop_invisible=False)
    assert len(back) == n
    back.validate(avatar.head.n_faces)
    # order within a triangle is the encoder's: match by the nearest colour and opacity there
    error, worth = [], []
    for row in range(n):
        mates = np.flatnonzero(back.binding == avatar.gaussians.binding[row])
        error.append(np.abs(back.sh_dc[mates] - avatar.gaussians.sh_dc[row]).sum(axis=1).min())
        worth.append(importance.sh_dc[row].sum())
    error, worth = np.array(error), np.array(worth)
    high, low = worth > np.quantile(worth, 0.75), worth < np.quantile(worth, 0.25)
    assert np.median(error[high]) < np.median(error[low])
