"""Pruning by score: exact counts, order, regions and the three guards."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.density.guard import guarded
from sacha_core.density.selection import lowest_of_all, lowest_of_each_region, quota


@st.composite
def populations(draw):
    """Give scores with many ties, bindings to triangles of one region each, regions and ratios."""
    n, n_faces = draw(st.integers(1, 150)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    label = rng.integers(0, 8, n_faces)
    binding = rng.integers(0, n_faces, n)
    percent = rng.integers(0, 100, 8)
    return rng.integers(0, 12, n) / 4.0, label[binding], percent, binding


@given(st.integers(0, 5000), st.integers(0, 100))
def test_a_quota_is_the_floor_of_the_numbers_as_written(count, percent) -> None:
    assert quota(count, percent / 100) == int(Fraction(percent, 100) * count)


@given(populations())
def test_without_guard_each_region_loses_exactly_its_quota_of_lowest_scores(population) -> None:
    score, regions, percent, binding = population
    chosen = lowest_of_each_region(score, regions, percent / 100, binding)
    assert np.array_equal(chosen.removed, chosen.requested)
    for region in range(8):
        members = np.flatnonzero(regions == region)
        count = int(Fraction(int(percent[region]), 100) * len(members))
        assert chosen.removed[region] == count
        by_hand = sorted(members, key=lambda i: (score[i], i))[:count]
        assert set(np.flatnonzero(chosen.remove & (regions == region))) == set(by_hand)


@given(populations(), st.integers(0, 2**32))
def test_the_scores_removed_do_not_depend_on_the_order_of_gaussians(population, seed) -> None:
    score, regions, percent, binding = population
    shuffled = np.random.default_rng(seed).permutation(len(score))
    a = lowest_of_each_region(score, regions, percent / 100, binding)
    b = lowest_of_each_region(score[shuffled], regions[shuffled], percent / 100, binding[shuffled])
    for region in range(8):
        first, second = a.remove & (regions == region), b.remove & (regions[shuffled] == region)
        assert np.array_equal(np.sort(score[first]), np.sort(score[shuffled][second]))
    strict = score + np.arange(len(score)) * 1e-6  # without ties, the very same Gaussians go
    a = lowest_of_each_region(strict, regions, percent / 100, binding)
    b = lowest_of_each_region(strict[shuffled], regions[shuffled], percent / 100, binding[shuffled])
    assert np.array_equal(a.remove[shuffled], b.remove)


@given(populations())
def test_exclude_keeps_the_best_of_every_triangle_and_fills_the_quota_from_the_rest(population) -> None:
    score, regions, percent, binding = population
    chosen = lowest_of_each_region(score, regions, percent / 100, binding, "exclude")
    for face in np.unique(binding):
        mine = np.flatnonzero(binding == face)
        best = max(mine, key=lambda i: (score[i], i))
        assert not chosen.remove[best]
    for region in range(8):
        spare = np.sum(regions == region) - len(np.unique(binding[regions == region]))
        assert chosen.removed[region] == min(chosen.requested[region], spare)


@given(populations())
def test_after_spares_only_triangles_that_would_be_empty(population) -> None:
    score, regions, percent, binding = population
    off = lowest_of_each_region(score, regions, percent / 100, binding, "off")
    after = lowest_of_each_region(score, regions, percent / 100, binding, "after")
    for face in np.unique(binding):
        mine = binding == face
        expected = np.zeros(mine.sum(), bool) if off.remove[mine].all() else off.remove[mine]
        assert np.array_equal(after.remove[mine], expected)
    assert (after.removed <= after.requested).all()


@given(populations())
def test_guarding_twice_is_guarding_once(population) -> None:
    score, _, _, binding = population
    remove = score < 1.5
    once = guarded(remove, binding)
    assert np.array_equal(guarded(once, binding), once)
    assert set(binding) == set(binding[~once])


@pytest.mark.parametrize("guard", ["off", "exclude", "after"])
@given(population=populations(), percent=st.integers(0, 99))
def test_global_pruning_takes_the_lowest_of_all(population, percent, guard) -> None:
    score, regions, _, binding = population
    chosen = lowest_of_all(score, regions, 8, percent / 100, binding, guard)
    count = int(Fraction(percent, 100) * len(score))
    assert chosen.requested.sum() == count
    assert chosen.removed.sum() == chosen.remove.sum() <= count
    if guard == "off":
        assert set(np.flatnonzero(chosen.remove)) == set(sorted(range(len(score)), key=lambda i: (score[i], i))[:count])
    else:
        assert set(binding) == set(binding[~chosen.remove])


@pytest.mark.parametrize("guard", ["off", "exclude", "after"])
def test_a_region_of_one_gaussian_loses_it_only_to_a_quota_of_all(guard) -> None:
    score, regions, binding = np.array([0.0, 1, 2]), np.array([0, 1, 1]), np.array([0, 1, 2])
    kept = lowest_of_each_region(score, regions, np.array([0.9, 0.0]), binding, guard)
    assert not kept.remove.any()
    gone = lowest_of_each_region(score, regions, np.array([1.0, 0.0]), binding, guard)
    assert gone.remove.tolist() == [guard == "off", False, False]
    assert gone.requested.tolist() == [1, 0]


def test_nothing_to_prune_from() -> None:
    empty = np.zeros(0, int)
    assert len(lowest_of_each_region(np.zeros(0), empty, np.full(8, 0.2), empty, "exclude").remove) == 0
    assert len(lowest_of_all(np.zeros(0), empty, 8, 0.2, empty, "after").remove) == 0
