"""Avatars with one Gaussian for each vertex of the once-subdivided head mesh: which triangle each vertex belongs to.

Subdivision cuts a triangle into four: one at each corner and one in the middle. In the order (corner 0 of all triangles, corner 1 of
all, corner 2 of all) a vertex belongs to the triangle of the first cut that it is part of.

Source: subdivision as PyTorch3D does it (Ravi et al., 2020); the rule is what avatars made on such meshes are found to keep.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

from sacha_core.codec.template import Template

__all__ = ["LEAST_SHARE", "match_vertices", "middle_of", "triangle_of"]

LEAST_SHARE = 0.5  # of the vertices: fewer Gaussians may match by chance, and gain little


def middle_of(template: Template) -> Bool[np.ndarray, " m"]:
    """Tell which vertices, in coding order, are middles of edges."""
    return np.asarray(template.vertices.order >= len(template.grid))


def triangle_of(template: Template) -> Int[np.ndarray, " m"]:
    """Give the triangle of each vertex, in coding order; -1 for a vertex of no triangle."""
    return np.asarray(vertex_triangles(template)[template.vertices.order])


def vertex_triangles(template: Template) -> Int[np.ndarray, " m"]:
    """Give the triangle of each vertex: the head's own, then middles of edges in lexicographic order."""
    n, faces, edges = len(template.grid), template.faces, template.edges
    found = np.full(n + len(edges.ends), -1, np.int64)
    number = np.arange(len(faces))
    for corner in (2, 1, 0):  # what is written last stays: the first corner, of it the first triangle
        lowest = np.full(len(found), len(faces), np.int64)
        for vertices in (faces[:, corner], n + edges.of_face[:, corner], n + edges.of_face[:, (corner + 2) % 3]):
            np.minimum.at(lowest, vertices, number)
        found = np.where(lowest < len(faces), lowest, found)
    return found


def match_vertices(binding: Int[np.ndarray, " n"], template: Template) -> Int[np.ndarray, " n"] | None:
    """Find the vertex of each Gaussian, if they are an ordered subset of all vertices: in the head's order, or as a file was decoded.

    Args:
        binding: triangle of each Gaussian, in the avatar's own order.
        template: of its head.

    Returns:
        (n,) vertices in coding order; None where the avatar is no such one.
    """
    if not template.known or len(binding) < LEAST_SHARE * len(template.vertices):
        return None
    triangles, order = vertex_triangles(template), template.vertices.order
    found = ordered_subset(binding, triangles)
    if found is not None:
        return np.asarray(np.argsort(order)[found])
    return ordered_subset(binding, triangles[order])


def ordered_subset(binding: Int[np.ndarray, " n"], expected: Int[np.ndarray, " m"]) -> Int[np.ndarray, " n"] | None:
    """Give where a sequence stands in a longer one, ascending; None where it does not."""
    places, listed = np.empty(len(binding), np.int64), expected.tolist()
    place = 0
    for row, triangle in enumerate(binding.tolist()):
        while place < len(listed) and listed[place] != triangle:
            place += 1
        if place == len(listed):
            return None
        places[row] = place
        place += 1
    return places
