"""What is expected of a Gaussian: held to loops over exact integers, and to what makes a predictor a good one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_avatars import small_head

from sacha_core.codec import turning
from sacha_core.codec.kernels import gathers
from sacha_core.codec.order import KINDS, layout_by_triangle, layout_by_vertex
from sacha_core.codec.predicted import decode_predicted, encode_predicted
from sacha_core.codec.prediction import LIMIT, Linear, Mixture, fit_mixture
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.rotation import choose_weights
from sacha_core.codec.template import template_of
from sacha_core.codec.turning import Turning, TurnWeights, multiply
from sacha_core.errors import FormatError

HEAD = small_head()
TEMPLATE = template_of(HEAD.v_template, HEAD.faces)
WEIGHT_TOLERANCE = 4  # 64ths: a fit to some hundred samples with noise of a tenth of the signal


def crowded(seed: int):
    rng = np.random.default_rng(seed)
    return layout_by_triangle(
        rng.integers(0, 12, len(TEMPLATE.triangles)) * (rng.random(len(TEMPLATE.triangles)) < 0.2), TEMPLATE
    )


def random_mixture(n_components: int, rng: np.random.Generator) -> Mixture:
    weights = rng.integers(-128, 128, (KINDS, 2, n_components))
    across = np.tril(rng.integers(-128, 128, (n_components, n_components)), -1)
    return Mixture(rng.integers(-(2**40), 2**40, n_components), weights, across)


@given(st.integers(0, 1000), st.integers(1, 4))
def test_mixtures_come_back(seed, n_components):
    mixture = random_mixture(n_components, np.random.default_rng(seed))
    back = Mixture.unpack(ByteReader(mixture.pack(), "section"), n_components)
    assert back.centre.tolist() == mixture.centre.tolist()
    assert back.weights.tolist() == mixture.weights.tolist()
    assert back.across.tolist() == mixture.across.tolist()


def test_a_centre_beyond_all_attributes_is_refused():
    mixture = replace(random_mixture(2, np.random.default_rng(0)), centre=np.array([0, LIMIT + 1]))
    with pytest.raises(FormatError, match="centre"):
        Mixture.unpack(ByteReader(mixture.pack(), "section"), 2)


def mean(values, rows, trust):
    return (sum(v * t for v, t in zip((values[r] for r in rows), trust, strict=True)) + 32) >> 6


@pytest.mark.parametrize("by_vertex", [False, True])
def test_expected_values_against_a_loop(by_vertex):
    """Oracle: the page's formula in Python integers, one Gaussian after another."""
    rng = np.random.default_rng(int(by_vertex))
    layout = layout_by_vertex(rng.random(len(TEMPLATE.vertices)) < 0.5, TEMPLATE) if by_vertex else crowded(3)
    values = rng.integers(-(2**38), 2**38, (len(layout), 3))
    mixture = random_mixture(3, rng)
    known = Linear(mixture, values)
    for step in layout.passes:
        known.enter(step)
        found = np.zeros((len(step.rows), 3), np.int64)
        for component in range(3):
            residual = known.residual(component)
            found[:, component] = values[step.rows, component] - residual
            known.learn(component, residual)
        lists = [array.tolist() for array in (step.near, step.trust, step.mates, step.mate_trust)]
        for i, row in enumerate(step.rows.tolist()):
            off = []
            for component in range(3):
                column, centre = values[:, component].tolist(), int(mixture.centre[component])
                total = 32
                for term, (rows, trust) in enumerate(((lists[0][i], lists[1][i]), (lists[2][i], lists[3][i]))):
                    weight = int(mixture.weights[step.kind, term, component])
                    total += weight * (mean(column, rows, trust) - centre) if sum(trust) else 0
                predicted = centre + (total >> 6)
                crossed = sum(o * int(mixture.across[component, j]) for j, o in enumerate(off))
                assert found[i, component] == predicted + ((crossed + 32) >> 6)
                off.append(column[row] - predicted)
    assert np.array_equal(known.values, values)


def test_fits_find_the_weights_that_made_the_values():
    """Oracle: values drawn from a mixture of known weights, with a few far outliers that least squares alone would follow."""
    layout, rng = crowded(1), np.random.default_rng(1)
    weights = np.zeros((KINDS, 2, 2), np.int64)
    weights[:, 0], weights[3] = 45, [[20, 10], [30, 40]]
    made = Mixture(np.zeros(2, np.int64), weights, np.array([[0, 0], [-50, 0]]))
    known = Linear(made, np.zeros((len(layout), 2), np.int64))
    for step in layout.passes:
        known.enter(step)
        for component in range(2):
            noise = rng.laplace(0, 3e4, len(step.rows)) * np.where(rng.random(len(step.rows)) < 0.01, 10, 1)
            known.learn(component, noise.astype(np.int64))
    steps = np.full((len(layout), 2), 1000)
    found = fit_mixture(layout, known.values, steps)
    assert abs(found.across[1, 0] + 50) <= WEIGHT_TOLERANCE
    assert (
        np.abs(found.weights[3] - weights[3]).max() <= 4 * WEIGHT_TOLERANCE
    )  # of mates and neighbours, which are alike


def test_smooth_values_take_fewer_bytes_than_shuffled_ones():
    """Metamorphic: what varies slowly over the head is expected well; the same values in another order are not."""
    layout = layout_by_vertex(np.ones(len(TEMPLATE.vertices), bool), TEMPLATE)
    smooth = np.stack([layout.anchors[:, 0], layout.anchors.sum(axis=1)], axis=1) >> 4
    steps = np.full((len(layout), 1), 64)
    data, decoded = encode_predicted(layout, smooth, steps)
    shuffled = smooth[np.random.default_rng(0).permutation(len(smooth))]
    assert len(data) < 0.8 * len(encode_predicted(layout, shuffled, steps)[0])
    assert np.abs(decoded - smooth).max() <= 32
    assert np.array_equal(decode_predicted(ByteReader(data, "section"), layout, steps, 2), decoded)


def test_orientations_are_predicted_from_whom_they_resemble():
    """Gaussians of a triangle alike but told by any of their eight quaternions, others not: mates are trusted, and nothing is left."""
    layout, rng = crowded(2), np.random.default_rng(2)
    q = rng.normal(0, 1, (4, len(layout.firsts)))
    q = (q / np.linalg.norm(q, axis=0))[:, layout.slots]
    q = multiply(q, np.eye(4)[:, rng.integers(0, 4, len(layout))]) * rng.choice([-1, 1], len(layout))
    weights, _ = choose_weights(layout, q, np.full((len(layout), 3), 100))
    assert weights.weights[3, 0] < weights.weights[3, 1]
    known = Turning(weights, q)
    for step in layout.passes:
        known.enter(step)
        for component in range(3):
            residual = known.residual(component)
            if step.kind == 3:
                assert np.abs(residual).max() <= 1  # of 2^-14: firsts are rounded once
            known.learn(component, residual)


@pytest.mark.parametrize("columns", [(), (1,), (3,)])
@pytest.mark.parametrize("n_seen", [0, 1, 4, 8])
def test_compiled_means_are_those_of_numpy(columns, n_seen):
    """Oracle: the array operations, to the bit."""
    rng = np.random.default_rng(n_seen)
    values = rng.integers(-(2**40), 2**40, (600, *columns))
    rows = rng.integers(0, 600, (70, n_seen))
    trust = rng.multinomial(64, np.ones(n_seen) / max(n_seen, 1), 70) if n_seen else rows
    mean = np.empty((70, *columns), np.int64)
    gathers.mean_rows(values.reshape(600, -1), rows, trust, 6, mean.reshape(70, -1))
    plain = (np.einsum("pk...,pk->p...", values[rows], trust) + 32) >> 6
    assert np.array_equal(mean, plain)


def test_compiled_orientations_are_those_of_numpy(monkeypatch):
    """Oracle: the array operations, to the bit, ties of dot products included."""
    layout, rng = crowded(4), np.random.default_rng(4)
    known = rng.normal(0, 1, (4, len(layout)))
    known[:, ::3] = rng.integers(-1, 2, (4, len(known[0, ::3])))
    weights = TurnWeights(rng.integers(1, 256, (KINDS, 2)))
    monkeypatch.setattr(turning, "compiled_loops", lambda *_: None)
    plain = [weights.expect(step, known) for step in layout.passes]
    monkeypatch.setattr(turning, "compiled_loops", lambda *_: gathers)
    for step, expected in zip(layout.passes, plain, strict=True):
        assert weights.expect(step, known).tobytes() == expected.tobytes()
