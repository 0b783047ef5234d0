"""Oracle: the vertices that Gaussians were put at before they were shuffled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_avatars import random_gaussians

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec import decode, encode, inspect
from sacha_core.codec.anchor_search import search_vertices
from sacha_core.codec.anchors import triangle_of
from sacha_core.codec.encoder import places_of
from sacha_core.codec.template import template_of, unknown_template
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.geometry.triangle import triangle_frames

HEAD = synthetic_head("small")
TEMPLATE = template_of(HEAD.v_template, HEAD.faces)
OWNER = triangle_of(TEMPLATE)
LOST = 0.15  # of what order tells, at most, where it does not; measured 0.04 (0.3 where hair lies far off)
FOUND = 0.8  # of the vertices; measured 0.97


@pytest.fixture(scope="module")
def gaussians() -> Gaussians:
    """Give one for each vertex, in the head's order: off by up to a few triangles, smoothly, with colours as smooth."""
    rest = triangle_frames(HEAD.v_template, HEAD.faces)
    ends = TEMPLATE.edges.ends
    points = np.concatenate([HEAD.v_template, HEAD.v_template[ends].mean(axis=1)])
    binding = np.empty(len(OWNER), np.int32)
    binding[TEMPLATE.vertices.order] = OWNER
    points, binding = points[binding >= 0], binding[binding >= 0]
    rng = np.random.default_rng(0)
    at = points + 0.02 * np.sin(points @ rng.normal(0, 20, (3, 3))) + rng.normal(0, 2e-4, points.shape)
    local = np.einsum("nji,nj->ni", rest.rotation[binding], at - rest.origin[binding]) / rest.scale[binding, None]
    made = random_gaussians(len(points), HEAD.n_faces, 0)
    colour = np.sin(points @ rng.normal(0, 20, (3, 3)))
    seen = np.ones_like(made.opacity_logit)
    return replace(
        made, position=local.astype(np.float32), opacity_logit=seen, sh_dc=colour.astype(np.float32), binding=binding
    )


def test_vertices_of_shuffled_gaussians_are_found(gaussians: Gaussians) -> None:
    rows = np.random.default_rng(1).permutation(len(gaussians))[: int(0.9 * len(gaussians))]
    found = search_vertices(gaussians.binding[rows], gaussians.position[rows], TEMPLATE)
    listed = TEMPLATE.vertices.order[found]
    assert (listed == np.sort(TEMPLATE.vertices.order[OWNER >= 0])[rows]).mean() >= FOUND


def test_order_is_worth_little_more_than_what_is_found(gaussians: Gaussians) -> None:
    def size_of(given: Gaussians) -> int:
        return inspect(encode(Avatar(given, HEAD.reference), 4, head=HEAD)).gaussian_bytes

    rows = np.random.default_rng(1).permutation(len(gaussians))
    shuffled = gaussians.select(rows)
    doubled = gaussians.select(
        np.append(rows, rows[0])
    )  # one more than its triangle has vertices: so places are triangles
    told, by_search, by_triangle = size_of(gaussians), size_of(shuffled), size_of(doubled)
    assert by_search - told <= LOST * (by_triangle - told)


def test_what_was_decoded_is_where_it_was(gaussians: Gaussians) -> None:
    once = decode(encode(Avatar(gaussians, HEAD.reference), 2, head=HEAD), head=HEAD)
    place, by_vertex = places_of(once.gaussians, TEMPLATE)
    assert by_vertex
    np.testing.assert_array_equal(place, np.flatnonzero(OWNER >= 0))


@given(st.integers(0, 1000), st.floats(0.5, 1))
def test_each_finds_a_vertex_of_its_triangle_wherever_it_lies(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    used = rng.permutation(np.flatnonzero(OWNER >= 0))[: int(np.ceil(share * len(OWNER)))]
    found = search_vertices(OWNER[used], rng.normal(0, 10, (len(used), 3)).astype(np.float32), TEMPLATE)
    np.testing.assert_array_equal(OWNER[found], OWNER[used])
    assert len(np.unique(found)) == len(found)


def test_others_are_left_to_their_triangles() -> None:
    nowhere = np.zeros((len(OWNER), 3), np.float32)
    assert search_vertices(np.repeat(OWNER[:1], len(OWNER)), nowhere, TEMPLATE) is None
    assert search_vertices(OWNER[:10], nowhere[:10], TEMPLATE) is None
    assert search_vertices(OWNER[:0], nowhere[:0], unknown_template(4)) is None
