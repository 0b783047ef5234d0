"""The order of coding: every Gaussian once, and nothing predicted from what is not yet known."""

from __future__ import annotations

from fractions import Fraction
from math import floor

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from synthetic_avatars import small_head

from sacha_core.codec.order import FULL_TRUST, MATES, layout_by_triangle, layout_by_vertex, weighted_mean
from sacha_core.codec.places import CURVE_BITS, curve_index
from sacha_core.codec.template import template_of, unknown_template

HEAD = small_head()
TEMPLATE = template_of(HEAD.v_template, HEAD.faces)

counts_lists = st.lists(st.integers(0, 5) | st.sampled_from([0, 0, 17, 40]), max_size=40)


def assert_in_order(layout):
    """Every Gaussian once, and neighbours and mates known before."""
    known = np.zeros(len(layout), bool)
    for number, step in enumerate(layout.passes):
        assert not known[step.rows].any()
        assert (np.diff(step.rows) > 0).all()
        for rows, trust in ((step.near, step.trust), (step.mates, step.mate_trust)):
            assert known[rows[trust > 0]].all()
            assert (trust >= 0).all()
            assert np.isin(trust.sum(axis=1), [0, FULL_TRUST]).all()
        assert (layout.slots[step.mates] == step.slot[:, None])[step.mate_trust > 0].all()
        assert (layout.slots[step.near] != step.slot[:, None])[step.trust > 0].all()
        assert (step.mate_trust.any(axis=1) == (step.kind == MATES)).all()
        assert (step.trust.any(axis=1) == (number > 0 and len(layout.firsts) > 1)).all()
        known[step.rows] = True
    assert known.all()


@given(counts_lists)
def test_every_gaussian_is_coded_once_after_what_predicts_it(counts):
    assert_in_order(layout_by_triangle(np.array(counts, np.int64), unknown_template(len(counts))))


@given(st.integers(0, 1000), st.sampled_from([0.01, 0.3, 0.95, 1.0]), st.booleans())
def test_order_on_a_head(seed, share, by_vertex):
    rng = np.random.default_rng(seed)
    present = rng.random(len(TEMPLATE.vertices if by_vertex else TEMPLATE.triangles)) < share
    layout = layout_by_vertex(present, TEMPLATE) if by_vertex else layout_by_triangle(present * 1, TEMPLATE)
    assert len(layout) == present.sum()
    assert_in_order(layout)
    sizes = np.empty(len(TEMPLATE.size), np.int64)
    sizes[TEMPLATE.order] = TEMPLATE.size
    assert np.array_equal(layout.triangle_size, sizes[layout.binding])


def test_passes_grow_with_the_logarithm_of_the_counts():
    layout = layout_by_triangle(np.array([100_000]), unknown_template(1))
    assert len(layout.passes) < 40


@given(st.lists(st.integers(-(2**40), 2**40), min_size=2, max_size=2), st.integers(0, FULL_TRUST))
def test_weighted_mean_rounds_halves_up(values, trust):
    """Oracle: exact fractions."""
    exact = Fraction(values[0] * trust + values[1] * (FULL_TRUST - trust), FULL_TRUST)
    mean = weighted_mean(np.array(values), np.array([[0, 1]]), np.array([[trust, FULL_TRUST - trust]]))
    assert mean[0] == floor(exact + Fraction(1, 2))


def test_consecutive_cells_of_the_curve_touch():
    """Oracle: what makes a Hilbert curve one; the finest bits alone suffice to reach 8 x 8 x 8 cells."""
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    place = curve_index(cells << (CURVE_BITS - 3))
    assert len(np.unique(place)) == 512
    steps = np.abs(np.diff(cells[np.argsort(place)], axis=0)).sum(axis=1)
    assert (steps == 1).all()


def test_triangle_sizes_are_eighths_of_an_octave():
    """Oracle: triangles alike but for their size, twice and four times the first's."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0], [2, 0, 0], [4, 0, 0], [0, 4, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 4, 3], [0, 5, 6]])
    template = template_of(vertices, faces)
    assert template.size[np.argsort(template.order)].tolist() == [-8, 0, 8]


def test_template_does_not_depend_on_units_that_are_powers_of_two():
    rng = np.random.default_rng(4)
    vertices = rng.normal(0, 0.1, (60, 3)).astype(np.float32)
    faces = rng.integers(0, 60, (90, 3))
    metres, sixtyfourths = template_of(vertices, faces), template_of(vertices * 64, faces)
    assert np.array_equal(metres.order, sixtyfourths.order)
    assert np.array_equal(metres.size, sixtyfourths.size)
