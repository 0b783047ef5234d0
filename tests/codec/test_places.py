"""Which places lie where, and which known ones are nearest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_avatars import small_head

from sacha_core.codec.anchors import match_vertices, vertex_triangles
from sacha_core.codec.mesh import edges_of
from sacha_core.codec.places import FULL_TRUST, NEAREST, nearest_known
from sacha_core.codec.template import template_of, unknown_template

HEAD = small_head()
TEMPLATE = template_of(HEAD.v_template, HEAD.faces)


def naive_edges(faces):
    """Oracle: a dictionary of edges and the sides on them, by a loop."""
    sides = {}
    for face, corners in enumerate(faces.tolist()):
        for side in range(3):
            edge = tuple(sorted((corners[side], corners[(side + 1) % 3])))
            sides.setdefault(edge, []).append((face, side))
    return dict(sorted(sides.items()))


@pytest.mark.parametrize(
    "faces", [HEAD.faces, np.array([[0, 1, 2], [2, 1, 3], [1, 2, 4], [3, 0, 5]])], ids=["head", "odd"]
)
def test_edges_against_a_loop(faces):
    naive, edges = naive_edges(faces), edges_of(faces.astype(np.int64), int(faces.max()) + 1)
    assert list(naive) == [tuple(row) for row in edges.ends.tolist()]
    across = np.full(faces.shape, -1)
    for number, found in enumerate(naive.values()):
        for face, side in found:
            assert edges.of_face[face, side] == number
        if len(found) > 1:
            (a, i), (b, j) = found[:2]
            across[a, i], across[b, j] = b, a
    assert np.array_equal(edges.across, across)
    for vertex, row in enumerate(edges.around.tolist()):
        assert [x for x in row if x >= 0] == sorted({b if a == vertex else a for a, b in naive if vertex in (a, b)})[
            :10
        ]


def test_beside_the_middle_of_an_edge():
    """Oracle: two triangles drawn on paper."""
    edges = edges_of(np.array([[0, 1, 2], [2, 1, 3]]), 4)
    assert edges.ends.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert edges.beside[2].tolist() == [1, 2, 0, 5, 4, 3, 7, 8]
    assert edges.beside[0].tolist() == [0, 1, 2, 6, 5, -1, -1, -1]


@given(st.integers(0, 1000), st.sampled_from([0, 1, 2, 5, 60, 250]))
def test_nearest_known_against_a_loop(seed, n_known):
    """Oracle: the rule in exact integers, one place at a time."""
    rng = np.random.default_rng(seed)
    places = TEMPLATE.triangles
    known = np.zeros(len(places) + 1, bool)
    known[rng.choice(len(places), min(n_known, len(places)), replace=False)] = True
    asked = rng.integers(0, len(places), 6)
    near, trust = nearest_known(places, known, asked)
    listed = np.flatnonzero(known).tolist()
    for row, place in enumerate(asked.tolist()):
        before, behind = [x for x in listed if x < place][-2:], [x for x in listed if x > place][:2]
        candidates = [
            *before,
            *behind,
            *[x for x in places.beside[place].tolist() if x >= 0 and known[x] and x != place],
        ]
        squares = {x: sum(int(d) ** 2 for d in places.points[x] - places.points[place]) for x in candidates}
        best = sorted(squares, key=lambda x: squares[x])[:NEAREST]
        ratios = [(squares[best[0]] + 1) * 1024 // (squares[x] + 1) for x in best]
        expected = [64 * ratio // sum(ratios) for ratio in ratios]
        if expected:
            expected[0] += FULL_TRUST - sum(expected)
        assert trust[row][: len(best)].tolist() == expected
        assert near[row][: len(best)].tolist() == best
        assert not trust[row][len(best) :].any()


def naive_vertex_triangles(faces, n_vertices):
    """Oracle: cut every triangle in four and look each vertex up in the cuts, in order."""
    numbers = {edge: n_vertices + i for i, edge in enumerate(naive_edges(faces))}
    cuts = []
    for corner in range(3):
        for face in faces.tolist():
            a, b, c = (face[(corner + turn) % 3] for turn in range(3))
            cuts.append({a, numbers[tuple(sorted((a, b)))], numbers[tuple(sorted((a, c)))]})
    return [
        next((i % len(faces) for i, cut in enumerate(cuts) if vertex in cut), -1)
        for vertex in range(n_vertices + len(numbers))
    ]


def test_triangles_of_vertices_against_subdivision():
    assert vertex_triangles(TEMPLATE).tolist() == naive_vertex_triangles(HEAD.faces, len(HEAD.v_template))


@given(st.integers(0, 1000), st.sampled_from([0.6, 0.95, 1.0]), st.booleans())
def test_ordered_subsets_of_the_vertices_are_found(seed, share, as_decoded):
    bound, order = vertex_triangles(TEMPLATE), TEMPLATE.vertices.order
    listed = bound[order] if as_decoded else bound
    subset = np.flatnonzero(np.random.default_rng(seed).random(len(bound)) < share)
    found = match_vertices(listed[subset], TEMPLATE)
    assert np.array_equal(bound[order][found], listed[subset])
    assert (np.diff(found if as_decoded else order[found]) > 0).all()
    if share == 1:
        assert np.array_equal(found if as_decoded else order[found], subset)


def test_other_avatars_are_not_taken_for_one_with_a_gaussian_a_vertex():
    bound = vertex_triangles(TEMPLATE)
    assert match_vertices(bound[::-1], TEMPLATE) is None
    assert match_vertices(bound[: len(bound) // 3], TEMPLATE) is None
    assert match_vertices(np.concatenate([bound, bound[:1]]), TEMPLATE) is None
    assert match_vertices(np.zeros(0, np.int64), unknown_template(4)) is None


def test_middles_lie_half_way():
    """Oracle: trimesh's subdivision has the same vertices, if in another order."""
    from trimesh.remesh import subdivide  # noqa: PLC0415  # slow to import

    vertices, _ = subdivide(TEMPLATE.grid * 2, TEMPLATE.faces)
    assert sorted(map(tuple, TEMPLATE.vertices.points.tolist())) == sorted(map(tuple, vertices.astype(int).tolist()))
