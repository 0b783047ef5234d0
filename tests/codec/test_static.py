"""Oracles: a decoder written from FORMAT.md, half a step, and the same offsets coded one by one."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from reference_decoder import offsets_of
from reference_motion import static_of
from reference_places import known_head
from synthetic_avatars import random_avatar

from sacha_core.codec import decode, encode
from sacha_core.codec.levels import LEVELS
from sacha_core.codec.reading import ByteReader
from sacha_core.codec.static import NEARBY, ONE_BY_ONE, by_those_nearby, decode_static, encode_static, to_levels
from sacha_core.codec.template import Template, template_of, unknown_template
from sacha_core.errors import FormatError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic.head import synthetic_head

SHAPE_STEP, OFFSET_STEP, WAY_AT = 0.005, 2e-5, 16


@pytest.fixture(scope="module")
def head() -> HeadModel:
    return synthetic_head("small")


@pytest.fixture(scope="module")
def template(head) -> Template:
    return template_of(head.v_template, head.faces)


def smooth(head: HeadModel) -> np.ndarray:
    """Offsets that change slowly over the head."""
    v = head.v_template.astype(float)
    return (3e-3 * np.sin(12 * v[:, [1, 2, 0]] + [0, 1, 2])).astype(np.float32)


def coded(offsets: np.ndarray, template: Template | None) -> bytes:
    return encode_static(np.ones(5, np.float32), offsets, SHAPE_STEP, OFFSET_STEP, template)


def coded_nearby(offsets: np.ndarray, template: Template) -> bytes:
    """Code in way 1, which on a head so small is seldom the shorter one."""
    levels = np.full(5, round(1 / SHAPE_STEP)), to_levels(offsets, OFFSET_STEP)
    return struct.pack("<dd", SHAPE_STEP, OFFSET_STEP) + by_those_nearby(*levels, template)


@pytest.mark.parametrize("kind", ["smooth", "nothing", "noise"])
@pytest.mark.parametrize("way", [ONE_BY_ONE, NEARBY])
def test_the_page_alone_decodes_the_same_values(head, template, kind, way):
    v = len(head.v_template)
    noise = np.random.default_rng(0).normal(0, 1e-3, (v, 3))
    offsets = {"smooth": smooth(head), "nothing": np.zeros((v, 3)), "noise": noise}[kind].astype(np.float32)
    data = coded_nearby(offsets, template) if way else coded(offsets, None)
    assert data[WAY_AT] == way
    shape, ours = decode_static(ByteReader(data, "Static"), 5, v, template)
    vertices = known_head(head.v_template, head.faces).vertices
    theirs = static_of(data, 5, v, lambda fields: offsets_of(fields, vertices))
    assert np.array_equal(shape, theirs["shape"].astype(np.float32))
    assert np.array_equal(ours, theirs["static_offset"].astype(np.float32))
    assert np.abs(ours - offsets).max() <= 0.5001 * OFFSET_STEP


def test_where_neighbours_have_far_numbers_offsets_take_less_by_vertices_nearby():
    """The synthetic head numbers its vertices ring by ring, which nobody else does."""
    head = synthetic_head("full")
    shuffled = np.random.default_rng(1).permutation(len(head.v_template))
    template = template_of(head.v_template[shuffled], np.argsort(shuffled)[head.faces].astype(np.int32))
    offsets = smooth(head)[shuffled]
    assert len(coded(offsets, template)) < 0.7 * len(coded(offsets, None))


def test_a_way_that_needs_the_head_is_refused_without_it(head, template):
    data = coded_nearby(smooth(head), template)
    v = len(head.v_template)
    for known, n_offsets in ((unknown_template(len(head.faces)), v), (template, 0)):
        with pytest.raises(FormatError, match="way 1"):
            decode_static(ByteReader(data, "Static"), 5, n_offsets, known)
    wrong = data[:WAY_AT] + b"\2" + data[WAY_AT + 1 :]
    with pytest.raises(FormatError, match="way 2"):
        decode_static(ByteReader(wrong, "Static"), 5, v, template)


def test_any_bytes_decode_or_are_refused(head, template):
    data = coded_nearby(smooth(head), template)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        changed = bytearray(data[: rng.integers(WAY_AT, len(data) + 1)])
        changed[rng.integers(len(changed))] = rng.integers(256)
        try:
            _, offsets = decode_static(ByteReader(bytes(changed), "Static"), 5, len(head.v_template), template)
        except FormatError:
            continue
        assert np.isfinite(offsets).all()


def test_offsets_of_an_avatar_come_back(head):
    avatar = random_avatar(12, n_frames=2, head=head)
    back = decode(encode(avatar, 2, head=head), head=head).motion
    assert np.abs(back.static_offset - avatar.motion.static_offset).max() <= 0.5001 * LEVELS[2].offset_step
