"""Sections one by one: what the encoder believes the decoder has is what it has, and errors stay within half a step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from synthetic_avatars import small_head

from sacha_core.codec.colour import decode_colour, encode_colour, yuv_to_rgb
from sacha_core.codec.counts import decode_layout, encode_layout
from sacha_core.codec.frames import quaternions_of
from sacha_core.codec.hidden import decode_hidden, encode_hidden
from sacha_core.codec.levels import COLOUR_RULES, POSITION_RULE, ROTATION_RULES, SCALE_RULES
from sacha_core.codec.opacity import decode_opacity, encode_opacity, opacity_index, opacity_table
from sacha_core.codec.order import Layout, layout_by_triangle, layout_by_vertex
from sacha_core.codec.position import (
    TRIANGLE,
    decode_position,
    encode_position,
    from_world,
    position_steps,
    to_world,
)
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.rotation import decode_rotation, encode_rotation, sort_axes
from sacha_core.codec.rotation import steps_of as rotation_steps
from sacha_core.codec.scale import classes_of, decode_scale, encode_scale, known_classes
from sacha_core.codec.static import decode_static, encode_static
from sacha_core.codec.steps import MAX_EXPONENT, STEPS, Classes, StepRule
from sacha_core.codec.template import Template, template_of, unknown_template
from sacha_core.codec.turning import TurnWeights, conjugate, multiply, nearest_to, rotation_vector
from sacha_core.errors import FormatError
from sacha_core.geometry.triangle import triangle_frames

FLOAT32_ROUNDING = 1e-6  # relative: decoded values are rounded to float32 once
ANGLE_TOLERANCE = 1e-6  # of rotation matrices in float64 through a product and a square root
LOGIT_TOLERANCE = 1e-9  # relative, of a float64 library logarithm against 40 digits

counts_lists = st.lists(st.integers(0, 4) | st.sampled_from([0, 9]), min_size=1, max_size=12)


def layout_of(counts: list[int], seed: int = 0) -> Layout:
    """Give a layout in a random order of triangles of random sizes."""
    return layout_by_triangle(np.array(counts, np.int64), template_for(len(counts), seed))


def template_for(n_faces: int, seed: int = 0) -> Template:
    rng = np.random.default_rng(seed)
    plain = unknown_template(n_faces)
    places = replace(plain.triangles, order=rng.permutation(n_faces))
    return replace(plain, triangles=places, size=rng.integers(-5, 6, n_faces))


def classes_for(n: int, seed: int = 0) -> Classes:
    rng = np.random.default_rng(seed)
    return Classes(rng.integers(0, 25, n), rng.integers(-60, 20, n), rng.integers(0, 12, n), rng.integers(0, 5, n))


def reader(data: bytes) -> ByteReader:
    return ByteReader(data, "section")


@given(st.lists(st.integers(0, 300), max_size=60), st.integers(0, 5))
def test_counts_by_triangle(counts, seed):
    template = template_for(len(counts), seed)
    data = encode_layout(np.array(counts, np.int64), template, by_vertex=False)
    layout = decode_layout(reader(data), template, sum(counts))
    assert np.array_equal(layout.binding, np.repeat(template.order, counts))
    assert layout.anchors is None
    with pytest.raises(FormatError, match=r"add up to|expected 0 to"):
        decode_layout(reader(data), template, sum(counts) + 1)


@given(st.integers(0, 100), st.sampled_from([0.0, 0.5, 0.95, 1.0]))
def test_presence_by_vertex(seed, share):
    head = small_head()
    template = template_of(head.v_template, head.faces)
    present = np.random.default_rng(seed).random(len(template.vertices)) < share
    layout = decode_layout(
        reader(encode_layout(present.astype(np.int64), template, by_vertex=True)), template, present.sum()
    )
    assert np.array_equal(layout.anchors, template.vertices.points[present])
    with pytest.raises(FormatError, match="with the head"):
        decode_layout(reader(b"\x01"), unknown_template(5), 0)


@given(counts_lists, st.sampled_from([1, 2, 24, 1024]), st.sampled_from([0, 5, 60]), st.integers(0, 100))
def test_opacity(counts, n_steps, hidden_weight, seed):
    layout = layout_of(counts)
    rng = np.random.default_rng(seed)
    index, hidden = rng.integers(0, n_steps + 1, sum(counts)), rng.integers(0, 4, sum(counts))
    index = index[np.lexsort((-index, layout.slots))]
    data, expected = encode_opacity(layout, index, n_steps, hidden, hidden_weight)
    decoded, table = decode_opacity(reader(data), layout, hidden)
    assert np.array_equal(decoded, expected)
    spacing = np.minimum(STEPS[hidden * hidden_weight], n_steps)
    assert (np.abs(decoded - index)[spacing == 1] == 0).all()
    assert (np.abs(decoded - index) < np.maximum(spacing, 1)).all()  # half a spacing, or all of it at the table's ends
    assert len(table.logit) == n_steps + 1


@pytest.mark.parametrize("n_steps", [1, 7, 36, 72, 1024])
def test_opacity_table_against_the_library(n_steps):
    """Oracle: sin^2 and log of the platform's libm in float64."""
    inside = np.clip(np.arange(n_steps + 1.0), 0.25, n_steps - 0.25)
    angle = np.pi / 2 * inside / n_steps
    table = opacity_table(n_steps)
    assert np.allclose(table.logit, 2 * np.log(np.tan(angle)), rtol=FLOAT32_ROUNDING, atol=FLOAT32_ROUNDING)
    assert np.array_equal(table.logit, -table.logit[::-1])  # the middle one is exactly 0
    octaves = -2 * np.log2(np.sin(angle) ** 2)
    off = np.abs(table.transparency - np.minimum(octaves, 24))
    assert off.max() <= 0.5 + LOGIT_TOLERANCE


@given(
    st.lists(st.floats(-(2.0**127), 2.0**127, width=32) | st.floats(-12, 12, width=32), min_size=1),
    st.integers(1, 1024),
)
def test_opacity_index_is_the_nearest(logits, n_steps):
    """Extreme logits and denormals included."""
    logit = np.array(logits, np.float32)
    index = opacity_index(logit, n_steps)
    alpha = 1 / (1 + np.exp(-np.clip(logit.astype(np.float64), -700, 700)))
    angle = np.arcsin(np.sqrt(alpha)) / (np.pi / 2) * n_steps
    assert index.min() >= 0
    assert index.max() <= n_steps
    assert np.abs(index - angle).max() <= 0.5 + 1e-6


@given(counts_lists, st.integers(0, 7), st.integers(0, 50))
def test_hidden(counts, most, seed):
    layout = layout_of(counts)
    hidden = np.random.default_rng(seed).integers(0, most + 1, sum(counts))
    assert np.array_equal(decode_hidden(reader(encode_hidden(layout, hidden)), layout), hidden)


def test_class_out_of_range_is_refused():
    layout = layout_of([3])
    data = encode_hidden(layout, np.array([1, 8, 2]))
    with pytest.raises(FormatError, match="outside 0 to 7"):
        decode_hidden(reader(data), layout)


@given(counts_lists, st.floats(0.0, 8.0), st.integers(0, 50))
def test_scale(counts, spread, seed):
    layout = layout_of(counts, seed)
    rng = np.random.default_rng(seed)
    log_scale = -np.sort(-rng.normal(-3, spread, (sum(counts), 3)), axis=1)
    transparency = rng.integers(0, 25, sum(counts))
    known = known_classes(transparency, rng.integers(0, 8, sum(counts)))
    data, expected = encode_scale(layout, log_scale, known, SCALE_RULES)
    decoded, integers = decode_scale(reader(data), layout, known)
    assert np.array_equal(integers, expected)
    step = np.stack([rule.steps(known) for rule in SCALE_RULES], 1)
    # the integer of each axis is within half a step, half a unit of rounding apart; decoding rounds to float32
    assert (np.abs(decoded - log_scale) <= (step / 2 + 2.5) * 2.0**-12 + FLOAT32_ROUNDING * np.abs(log_scale)).all()


def layouts(seed: int) -> list[Layout]:
    """Give one of each kind: triangles without a head, triangles of a head, vertices of a head."""
    rng = np.random.default_rng(seed)
    head = small_head()
    template = template_of(head.v_template, head.faces)
    counts = rng.integers(0, 3, len(head.faces)) * (rng.random(len(head.faces)) < 0.3)
    return [
        layout_of(rng.integers(0, 5, 12).tolist(), seed),
        layout_by_triangle(counts, template),
        layout_by_vertex(rng.random(len(template.vertices)) < 0.4, template),
    ]


@pytest.mark.parametrize("kind", range(3))
@pytest.mark.parametrize("spread", [0.0, 0.3, 90.0])
def test_position(kind, spread):
    """Half a step off in either domain; in the world a step is alike in metres to within the rounding of size classes."""
    layout = layouts(kind)[kind]
    n = len(layout)
    position = np.random.default_rng(kind).normal(0, spread, (n, 3)).astype(np.float32)
    classes = classes_for(n, kind)
    data, expected = encode_position(layout, position, classes, POSITION_RULE)
    decoded = decode_position(reader(data), layout, classes)
    assert np.array_equal(decoded, expected)
    rule = StepRule.unpack(reader(data[1:]))
    steps = position_steps(layout, classes, rule, data[0])[:, 0] / 2 + 1
    if data[0] == TRIANGLE:
        bound, error = steps[:, None] * 2.0**-16, np.abs(decoded - position)
    else:
        frames = layout.template.frames(layout.binding)
        error = np.abs(np.einsum("ijn,nj->ni", frames.axes, decoded - position)) * frames.scale[:, None]
        bound = steps[:, None] / 16 + FLOAT32_ROUNDING * (np.abs(position).max(axis=1) * frames.scale)[:, None] * 2
    assert (error <= bound + FLOAT32_ROUNDING * np.abs(position)).all()


def test_world_and_triangle_are_the_same_place():
    """Oracle: posed triangle frames of the geometry package on the grid's vertices."""
    layout = layouts(5)[2]
    template = layout.template
    frames = triangle_frames(template.grid.astype(np.float64), template.faces)
    position = np.random.default_rng(0).normal(0, 0.5, (len(layout), 3))
    world = np.einsum("nij,nj->ni", frames.rotation[layout.binding], position) * frames.scale[layout.binding, None]
    world += frames.origin[layout.binding]
    values = to_world(layout, position)
    assert np.abs(values / 16 + layout.anchors / 2 - world).max() <= 1 / 32 + ANGLE_TOLERANCE
    back = from_world(layout, values)
    assert np.abs(back - position).max() * frames.scale.min() < 0.1  # cells; a unit is a sixteenth
    axes = template.frames(layout.binding).axes
    turned = Rotation.from_quat(quaternions_of(axes).T, scalar_first=True).as_matrix()
    assert np.allclose(turned, axes.transpose(2, 0, 1), atol=ANGLE_TOLERANCE)


@pytest.mark.parametrize("kind", range(3))
def test_rotation(kind):
    """Oracle: SciPy's angle between what went in and what comes out, up to half turns about a Gaussian's own axes."""
    layout = layouts(kind)[kind]
    n = len(layout)
    quaternion = np.random.default_rng(kind).normal(0, 1, (n, 4)) * ([1, 0.1, 0.1, 0.1] if kind else [1, 1, 1, 1])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    classes = classes_for(n, kind)
    data, expected = encode_rotation(layout, quaternion, classes, ROTATION_RULES)
    decoded = decode_rotation(reader(data), layout, classes)
    assert np.array_equal(decoded, expected)
    assert np.allclose(np.linalg.norm(decoded, axis=1), 1, atol=FLOAT32_ROUNDING)
    turn = Rotation.from_quat(quaternion, scalar_first=True).inv() * Rotation.from_quat(decoded, scalar_first=True)
    halves = Rotation.from_quat(np.eye(4), scalar_first=True)
    angle = np.min([(turn * half).magnitude() for half in halves], axis=0)
    largest = np.linalg.norm(rotation_steps(ROTATION_RULES, classes) / 2 + 1, axis=1) * 2.0**-14
    assert (angle <= 2 * np.arcsin(np.minimum(largest * 2, 1)) + 2 * ANGLE_TOLERANCE).all()


def test_turns_from_neighbours_by_the_half_turn():
    """A Gaussian told by another of its eight quaternions is no turn at all; nothing known is expected to be the axes themselves."""
    q = np.random.default_rng(1).normal(0, 1, (4, 50))
    q /= np.linalg.norm(q, axis=0)
    for half in np.eye(4):
        for sign in (1, -1):
            other = sign * multiply(q, np.tile(half[:, None], 50))
            assert np.allclose(nearest_to(other, q), q, atol=ANGLE_TOLERANCE)
            assert np.abs(rotation_vector(multiply(conjugate(q), other))).max() < ANGLE_TOLERANCE
    no_turn = np.array([[1.0], [0], [0], [0]])
    assert np.array_equal(rotation_vector(q), nearest_to(q, no_turn)[1:])
    step = layouts(0)[0].passes[0]
    assert TurnWeights(np.full((4, 2), 255)).expect(step, q).tolist() == [[1], [0], [0], [0]]


@pytest.mark.parametrize("decoder", [decode_position, decode_rotation])
def test_unknown_domains_are_refused(decoder):
    plain, _, on_vertices = layouts(1)
    for layout, domain in ((plain, 1), (plain, 2), (on_vertices, 2)):
        with pytest.raises(FormatError, match="domain"):
            decoder(reader(bytes([domain]) + bytes(80)), layout, classes_for(len(layout)))


@given(st.integers(0, 200), st.booleans())
def test_sorting_axes_leaves_the_gaussian_as_it_is(seed, ties):
    """Oracle: SciPy's rotation matrices; the covariance R diag(s^2) R^T must not change."""
    rng = np.random.default_rng(seed)
    log_scale = rng.integers(-2, 2, (6, 3)).astype(np.float64) if ties else rng.normal(-1, 1, (6, 3))
    quaternion = rng.normal(0, 1, (6, 4))
    sorted_scale, turned = sort_axes(log_scale, quaternion)
    vector = rotation_vector(turned.T).T
    chosen = np.concatenate([np.sqrt(1 - (vector**2).sum(axis=1, keepdims=True)), vector], axis=1)
    assert (chosen[:, 0] >= 0.5 - ANGLE_TOLERANCE).all()
    assert (np.diff(sorted_scale, axis=1) <= 0).all()

    def covariance(scale: np.ndarray, wxyz: np.ndarray) -> np.ndarray:
        matrix = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
        return np.einsum("nij,nj,nkj->nik", matrix, np.exp(2 * scale), matrix)

    before = covariance(log_scale, quaternion)
    for after in (covariance(sorted_scale, turned), covariance(sorted_scale, chosen)):
        assert np.allclose(before, after, atol=ANGLE_TOLERANCE * np.abs(before).max())


def test_a_quaternion_of_length_zero_counts_as_no_rotation():
    _, turned = sort_axes(np.zeros((1, 3)), np.zeros((1, 4)))
    assert np.array_equal(turned, [[1, 0, 0, 0]])


@given(counts_lists, st.integers(0, 50))
def test_colour(counts, seed):
    layout = layout_of(counts, seed)
    sh_dc = np.random.default_rng(seed).normal(0, 1, (sum(counts), 3)).astype(np.float32)
    classes = classes_for(sum(counts), seed)
    data, expected = encode_colour(layout, sh_dc, classes, COLOUR_RULES)
    assert np.array_equal(decode_colour(reader(data), layout, classes), yuv_to_rgb(expected))


@given(st.integers(0, 40), st.integers(0, 30), st.integers(0, 50))
def test_static(n_shape, n_offsets, seed):
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 2, n_shape).astype(np.float32)
    offset = rng.normal(0, 1e-3, (n_offsets, 3)).astype(np.float32)
    data = encode_static(shape, offset, 0.01, 1e-4)
    shape_back, offset_back = decode_static(reader(data), n_shape, n_offsets, unknown_template(0))
    assert np.abs(shape_back - shape).max(initial=0) <= 0.005 * (1 + FLOAT32_ROUNDING) + FLOAT32_ROUNDING * 10
    assert np.abs(offset_back - offset).max(initial=0) <= 5e-5 * (1 + FLOAT32_ROUNDING) + FLOAT32_ROUNDING


def test_half_octaves_of_size():
    """Doubling both larger scales moves the class by two."""
    log_scale = np.log([[1.0, 1.0, 0.1], [2.0, 2.0, 0.1], [4.0, 1.0, 0.1]])
    classes = classes_of(
        known_classes(np.zeros(3, np.int64), np.zeros(3, np.int64)), np.rint(log_scale * 4096).astype(np.int64)
    )
    assert np.abs(classes.size - [0, 2, 2]).max() <= 1
    assert np.abs(classes.elongation - [0, 0, 4]).max() <= 1


@pytest.mark.parametrize(
    "bad", [StepRule(0, 0, 0, 0, -1, 0, 0), StepRule(0, 0, 0, 0, 0, 1, MAX_EXPONENT), StepRule(0, 0, 0, 0, 2, 1, 5)]
)
def test_rules_outside_the_table_are_refused(bad):
    with pytest.raises(FormatError, match="steps reach"):
        StepRule.unpack(reader(bad.pack()))
