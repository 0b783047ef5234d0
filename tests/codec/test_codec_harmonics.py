"""Harmonics: what the encoder believes the decoder has is what it has, a naive loop reads the same, and errors go where they cost least."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sacha_core.codec.grouping import LevelBits
from sacha_core.codec.harmonic_choice import cheapest
from sacha_core.codec.harmonic_contexts import N_CONTEXTS, ActivityPlan
from sacha_core.codec.harmonic_encoder import encode_harmonics
from sacha_core.codec.harmonic_metric import Metric, harmonics, ring_metric, sphere_directions, weigh
from sacha_core.codec.harmonics import LIMIT, Neighbourhood, Transform, decode_harmonics
from sacha_core.codec.levels import HARMONIC_RULE
from sacha_core.codec.order import Layout, layout_by_triangle
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.steps import STEPS, Classes
from sacha_core.codec.symbols import SymbolReader
from sacha_core.codec.template import unknown_template
from sacha_core.errors import FormatError
from sacha_core.raster.harmonics import sh_colours

BASIS_TOLERANCE = 2e-6  # float32 colours of magnitude 1 against float64 functions
SOLVE_TOLERANCE = 1e-4  # relative, of float32 metrics through a least-squares solution
N = 60


def layout_of(n: int) -> Layout:
    """Give a layout with lone Gaussians and with mates."""
    counts = np.zeros(max(n, 1), np.int64)
    np.add.at(counts, np.random.default_rng(n).integers(0, max(n // 2, 1), n), 1)
    return layout_by_triangle(counts, unknown_template(len(counts)))


def classes_for(n: int, seed: int = 0) -> Classes:
    rng = np.random.default_rng(seed)
    return Classes(rng.integers(0, 9, n), rng.integers(-12, 8, n), rng.integers(0, 12, n), rng.integers(0, 5, n))


def smooth_rest(n: int, n_harmonics: int, seed: int = 0) -> np.ndarray:
    """Give coefficients that neighbours share, with some of their own."""
    rng = np.random.default_rng(seed)
    own = rng.laplace(0, 0.03, (n, n_harmonics, 3))
    return (np.cumsum(rng.normal(0, 0.03, (n, n_harmonics, 3)), axis=0) + own).astype(np.float32)


def metric_for(n: int, n_harmonics: int, classes: Classes, seed: int | None = None) -> Metric:
    """Give a metric by the ring, or as if measured in a few views."""
    measured = None
    if seed is not None:
        seen = np.random.default_rng(seed).normal(0, 1, (n, 5, n_harmonics + 1)).astype(np.float32)
        measured = np.einsum("nvi,nvj->nij", seen, seen)
    return weigh(measured, None, n_harmonics + 1, HARMONIC_RULE, classes)


def coded(n: int, n_harmonics: int = 15, exponent: int = 0, seed: int | None = None):
    """Give section, coefficients as the encoder believes them, layout and classes."""
    classes, layout, rest = classes_for(n), layout_of(n), smooth_rest(n, n_harmonics)
    rule = replace(HARMONIC_RULE, base=HARMONIC_RULE.base + exponent)
    data, decoded = encode_harmonics(layout, rest, classes, rule, metric_for(n, n_harmonics, classes, seed))
    return data, decoded, layout, classes


def reader(data: bytes) -> ByteReader:
    return ByteReader(data, "Harmonic")


@pytest.mark.parametrize("n_harmonics", [3, 8, 15])
@pytest.mark.parametrize("n", [0, 1, 2, N])
@pytest.mark.parametrize(("exponent", "seed"), [(16, None), (-8, None), (-24, 3)])
def test_the_decoder_has_what_the_encoder_believes(n, n_harmonics, exponent, seed):
    data, expected, layout, classes = coded(n, n_harmonics, exponent, seed)
    assert np.array_equal(decode_harmonics(reader(data), layout, n_harmonics, classes), expected)
    assert expected.shape == (n, n_harmonics, 3)
    assert expected.dtype == np.float32


def near_mean(values, rows, trust):
    """Mean by trust, halves up."""
    return (sum(values[row] * weight for row, weight in zip(rows, trust, strict=True)) + 32) >> 6


def naive_decoder(data: bytes, layout: Layout, n_harmonics: int, classes: Classes) -> list:
    """FORMAT.md's "Harmonic", number by number; oracle: a naive loop. Only the symbols come through the package's reader."""
    read = reader(data)
    transform = Transform.unpack(read, n_harmonics)
    rule, components = transform.rule, [(f, a) for f in range(max(transform.counts)) for a in range(3)]
    components = [(f, a) for f, a in components if f < transform.counts[a]]
    follow = Neighbourhood.unpack(read, len(components)).weights
    plan = ActivityPlan.unpack(read, len(components))
    symbols = SymbolReader(read, N_CONTEXTS)
    n = len(layout)
    shift = [int(x) for x in rule.shift(classes)]
    scale = [int(STEPS[64 + min(x - rule.low, 127)]) for x in shift]
    values, sizes = [[0] * len(components) for _ in range(n)], [[0] * len(components) for _ in range(n)]
    for step in layout.passes:
        group, found = int(step.kind == 3), {}
        known = [
            (step.near[i].tolist(), step.trust[i].tolist(), step.mates[i].tolist(), step.mate_trust[i].tolist())
            for i in range(len(step.rows))
        ]
        contexts = []
        for i, row in enumerate(step.rows.tolist()):
            near, trust, mates, mate_trust = known[i]
            w = [int(x) for x in plan.weights[group]]
            for c in range(len(components)):
                total = w[0] * sum(sizes[r][c] * t for r, t in zip(near, trust, strict=True))
                total += w[1] * sum(sizes[r][c] * t for r, t in zip(mates, mate_trust, strict=True))
                estimate = int(STEPS[plan.floors[c]]) + (total // scale[row] >> 2)
                size = sum(int(2 ** Fraction(e, 8)) <= estimate for e in range(20, 112, 4))
                contexts.append(min(int(classes.transparency[row]), 3) * 24 + size)
        levels = iter(symbols.read(np.array(contexts, np.int64)).tolist())
        for row in step.rows.tolist():
            for c in range(len(components)):
                found[row, c] = next(levels)
                sizes[row][c] = min(abs(found[row, c]) * scale[row], 1 << 28)
        fresh = {}
        for i, row in enumerate(step.rows.tolist()):
            near, trust, mates, mate_trust = known[i]
            for c, (f, _) in enumerate(components):
                column = [v[c] for v in values]
                total = int(follow[group, 0, c]) * near_mean(column, near, trust)
                total += int(follow[group, 1, c]) * near_mean(column, mates, mate_trust)
                exponent = rule.base + shift[row] + int(transform.exponents[f])
                fresh[row, c] = ((total + 32) >> 6) + found[row, c] * int(STEPS[exponent])
        for (row, c), value in fresh.items():
            values[row][c] = value
    symbols.check_end()
    return [
        [
            [
                sum(
                    values[row][c] * int(transform.basis[f, k]) * int(transform.axes[a, channel])
                    for c, (f, a) in enumerate(components)
                )
                for channel in range(3)
            ]
            for k in range(n_harmonics)
        ]
        for row in range(n)
    ]


@pytest.mark.parametrize(("n_harmonics", "exponent"), [(15, -24), (8, -32), (3, -32)])
def test_a_naive_loop_reads_the_same(n_harmonics, exponent):
    data, expected, layout, classes = coded(N, n_harmonics, exponent, seed=2)
    sums = np.array(naive_decoder(data, layout, n_harmonics, classes), np.int64)
    assert np.count_nonzero(sums) > 0
    assert np.array_equal((sums * 2.0**-28).astype(np.float32), expected)


def test_sums_at_the_limit_stay_exact():
    """Oracle: integers of any size."""
    transform = Transform(HARMONIC_RULE, (15, 15, 15), np.full((3, 3), -127), np.full((15, 15), 127), np.zeros(15, int))
    values = np.full((1, 45), LIMIT - 1)
    exact = sum(int(value) * 127 * -127 for value in values[0])
    assert transform.coefficients(values)[0, 0, 0] == np.float32(exact * 2.0**-28)


@pytest.mark.parametrize("at", range(0, 200, 7))
@pytest.mark.parametrize("value", [0, 0x7F, 0x80, 0xFF])
def test_hostile_bytes_end_in_a_format_error_or_in_finite_numbers(at, value):
    data, _, layout, classes = coded(N, exponent=-8)
    hurt = bytearray(data)
    hurt[at % len(hurt)] = value
    try:
        rest = decode_harmonics(reader(bytes(hurt)), layout, 15, classes)
    except FormatError:
        return
    assert np.isfinite(rest).all()


def test_a_cut_section_is_refused():
    data, _, layout, classes = coded(20, exponent=-24)
    for length in range(0, len(data) - 4, 5):  # without its last words a stream may end well by chance
        with pytest.raises(FormatError):
            decode_harmonics(reader(data[:length]), layout, 15, classes)


def test_more_functions_than_coefficients_are_refused():
    data, _, layout, classes = coded(20, 8)
    hurt = bytearray(data)
    hurt[8] = 9
    with pytest.raises(FormatError, match="9 functions make 8 coefficients"):
        decode_harmonics(reader(bytes(hurt)), layout, 8, classes)


def test_functions_are_those_that_pictures_use():
    """Oracle: the rasteriser's harmonics, coefficient by coefficient."""
    directions = sphere_directions()
    for k in range(15):
        rest = np.zeros((len(directions), 15, 3), np.float32)
        rest[:, k] = 0.3
        colours = sh_colours(
            np.zeros((len(directions), 3), np.float32), rest, directions.astype(np.float32), np.zeros(3), 3
        )
        assert np.allclose(colours[:, 0] - 0.5, 0.3 * harmonics(directions)[:, k + 1], atol=BASIS_TOLERANCE)


def test_degree_0_takes_over_what_it_can():
    """Oracle: the least of the whole quadratic form over errors of degree 0, found by calculus."""
    classes, rng = classes_for(7), np.random.default_rng(0)
    metric, error = metric_for(7, 8, classes, seed=1), rng.normal(0, 1, (7, 8, 3))
    seen = np.random.default_rng(1).normal(0, 1, (7, 5, 9)).astype(np.float32)
    whole = np.einsum("nvi,nvj->nij", seen, seen).astype(np.float64)
    ring = ring_metric(None, 9).astype(np.float64)[0]
    by_rule = np.exp2(-HARMONIC_RULE.shift(classes) / 4.0)
    own = whole[:, 0, 0]
    whole += ring / ring[0, 0] * (0.01 * own.sum() / by_rule.sum() * by_rule + 1.5 * own)[:, None, None]
    moved = metric.folded(np.zeros((7, 3)), error)
    both = np.concatenate([-moved[:, None], error], axis=1)
    slope = np.einsum("nj,njc->nc", whole[:, 0], both)
    assert np.allclose(slope, 0, atol=SOLVE_TOLERANCE * np.abs(whole).max())
    left = np.einsum("nic,nij,njc->nc", both, whole, both)
    assert np.allclose(2.5 * np.einsum("nic,nij,njc->nc", error, metric.left, error), left, rtol=SOLVE_TOLERANCE)


def test_what_no_camera_tells_apart_costs_nothing():
    """Metamorphic: harmonics that sum to a constant over all views vanish into degree 0."""
    n, layout = N, layout_of(N)
    classes = Classes(*(np.zeros(n, np.int64) for _ in range(4)))
    views = harmonics(sphere_directions()[:5])
    measured = np.repeat((views.T @ views)[None], n, axis=0).astype(np.float32)
    flat = np.linalg.lstsq(views[:, 1:], np.ones(5), rcond=None)[0]  # five views cannot tell it from a constant
    rest = np.repeat(flat[None, :, None], 3, axis=2).repeat(n, axis=0).astype(np.float32)
    left = Metric(
        measured[:, 0, 0].astype(np.float64),
        measured[:, 0, 1:] / measured[:, :1, 0],
        measured[:, 1:, 1:] - measured[:, 0, 1:, None] * measured[:, 0, None, 1:] / measured[:, :1, :1],
    )
    data, decoded = encode_harmonics(layout, rest, classes, HARMONIC_RULE, left)
    seen = np.einsum("vk,nkc->nvc", views[:, 1:], rest - decoded)
    folded = left.folded(np.zeros((n, 3)), rest - decoded)
    assert np.abs(seen - folded[:, None] * views[0, 0]).max() < 2e-2  # one step of the rule, where colours are 1
    assert len(data) < 120


@given(st.floats(-6, 6), st.floats(0.1, 4), st.floats(0, 1), st.integers(0, 99))
def test_the_cheapest_level_is_the_cheapest_of_the_three(exact, worth, lagrangian, seed):
    """Oracle: a loop over all candidates."""
    bits = LevelBits(np.random.default_rng(seed).uniform(0, 9, (1, 223)))
    got = int(cheapest(np.array([exact]), np.array([worth]), lagrangian, (bits, np.zeros(1, np.int64)))[0])
    nearest = int(np.rint(exact))
    tried = [nearest, nearest - int(np.sign(nearest)), 0]
    costs = [worth * (exact - level) ** 2 + lagrangian * bits.table[0, level + 111] for level in tried]
    assert costs[tried.index(got)] == min(costs)


def test_coarser_steps_make_smaller_sections_and_finer_ones_nearer_values():
    """Metamorphic: rate falls and error grows with the step."""
    rest = smooth_rest(N, 15)
    runs = [coded(N, exponent=exponent)[:2] for exponent in (16, 0, -16, -32)]
    sizes, errors = [len(data) for data, _ in runs], [np.abs(decoded - rest).mean() for _, decoded in runs]
    assert all(small < large for small, large in itertools.pairwise(sizes))
    assert errors[-1] < errors[0]
