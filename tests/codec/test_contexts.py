"""Contexts of levels: as specified, decodable, and fitted so that they tell sizes apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.contexts import SIZE_CLASSES, ContextPlan, Sizes
from sacha_core.codec.fitting import descend, fit_plan
from sacha_core.codec.order import KINDS, MATES, Layout, layout_by_triangle
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import MAX_EXPONENT, STEPS
from sacha_core.codec.template import unknown_template
from sacha_core.errors import FormatError

RELATIVE = 0.05  # of weights found from 20,000 samples: their standard error is 1 to 2 %


def layout_of(counts: list[int]) -> Layout:
    return layout_by_triangle(np.array(counts, np.int64), unknown_template(len(counts)))


def random_plan(n_components: int, rng: np.random.Generator) -> ContextPlan:
    return ContextPlan(
        rng.integers(0, 256, (n_components, 2, 3 + n_components)),
        rng.integers(0, MAX_EXPONENT + 1, (n_components, 2)),
        rng.integers(0, 256, (n_components, KINDS)),
    )


@given(st.lists(st.integers(0, 9), min_size=1, max_size=9), st.integers(1, 3), st.integers(0, 99))
def test_contexts_are_what_the_specification_says(counts, n_components, seed):
    """Oracle: plain Python integers, Gaussian by Gaussian, from FORMAT.md."""
    rng = np.random.default_rng(seed)
    layout, plan = layout_of(counts), random_plan(n_components, rng)
    n = sum(counts)
    steps = STEPS[rng.integers(0, MAX_EXPONENT + 1, (n, n_components))]
    levels = rng.integers(-9, 10, (n, n_components)) * rng.choice([1, 1000, 1 << 24])
    sizes, known = Sizes(steps), [[0] * n_components for _ in range(n)]

    def mean(rows, trust, component):
        return (sum(int(t) * known[r][component] for r, t in zip(rows, trust, strict=True)) + 32) >> 6

    for step in layout.passes:
        sizes.enter(step)
        group = int(step.kind == MATES)
        fresh = {}
        for component in range(n_components):
            found = sizes.contexts(plan, component)
            for place, row in enumerate(step.rows):
                lists = ((step.near[place], step.trust[place]), (step.mates[place], step.mate_trust[place]))
                features = []
                for rows, trust in lists:
                    means = [mean(rows, trust, c) for c in range(n_components)]
                    features += [means[component], sum(means)]
                features += [min(abs(int(levels[row, c])) * int(steps[row, c]), 1 << 40) for c in range(component)]
                total = sum(int(a) * f for a, f in zip(plan.weights[component, group], features, strict=False))
                units = (total >> 6) + int(STEPS[plan.floors[component, group]])
                estimate = 16 * units // int(steps[row, component]) + int(plan.offsets[component, step.kind])
                assert found[place] == sum(math.isqrt(1 << k) <= estimate for k in range(2, 23))
                assert 0 <= found[place] < SIZE_CLASSES
            sizes.learn(component, levels[step.rows, component])
        for row in step.rows:
            fresh[int(row)] = [min(abs(int(levels[row, c])) * int(steps[row, c]), 1 << 40) for c in range(n_components)]
        for row, size in fresh.items():
            known[row] = size


@given(st.integers(1, 3), st.integers(0, 99))
def test_plans_come_back(n_components, seed):
    plan = random_plan(n_components, np.random.default_rng(seed))
    back = ContextPlan.unpack(ByteReader(plan.pack(), "x"), n_components)
    for name in ("weights", "floors", "offsets"):
        assert np.array_equal(getattr(back, name), getattr(plan, name))


def test_numbers_out_of_range_are_refused():
    plan = ContextPlan(np.zeros((1, 2, 4), np.int64), np.full((1, 2), MAX_EXPONENT + 1), np.zeros((1, 4), np.int64))
    with pytest.raises(FormatError, match="outside 0 to 223"):
        ContextPlan.unpack(ByteReader(plan.pack(), "x"), 1)


def test_weights_that_made_the_sizes_are_found_again():
    """Oracle: the weights of the exponential distributions that the sizes were drawn from."""
    rng = np.random.default_rng(0)
    design = rng.exponential(1.0, (20_000, 3))
    truth = np.array([0.5, 2.0, 0.0])
    found = descend(design, rng.exponential(design @ truth))
    assert np.allclose(found, truth, atol=RELATIVE * 2)


def test_every_update_makes_the_sizes_likelier():
    """A theorem of the updates; here between few and many of them, beside the best by one number alone."""
    rng = np.random.default_rng(1)
    design = np.abs(rng.normal(size=(500, 4)))
    sizes = rng.exponential(design @ [0.1, 1.0, 0.0, 0.3])

    def loss(estimate):
        return float((np.log(estimate) + sizes / estimate).sum())

    assert loss(design @ descend(design, sizes) + 1e-4) < loss(np.full(500, sizes.mean()))


def test_restless_neighbourhoods_get_other_contexts_than_quiet_ones():
    rng = np.random.default_rng(2)
    layout = layout_of([1] * 4096)
    restless = (np.arange(4096) // 512) % 2
    levels = np.rint(rng.laplace(0, 0.3 + 6.0 * restless)[:, None]).astype(np.int64)
    steps = np.full((4096, 1), 64)
    plan, sizes, contexts = fit_plan(layout, levels, steps), Sizes(steps), np.zeros(4096, np.int64)
    for step in layout.passes:
        sizes.enter(step)
        contexts[step.rows] = sizes.contexts(plan, 0)
        sizes.learn(0, levels[step.rows, 0])
    assert contexts[restless == 1].mean() > contexts[restless == 0].mean() + 4  # two octaves
