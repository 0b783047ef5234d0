"""Vertices of the once-subdivided head for Gaussians whose order does not tell: a scene from a viewer, or a file decoded and encoded again.

Each triangle's Gaussians go to its own vertices, each Gaussian to the one that explains best where it lies. They may lie far off, as on
hair, but then neighbours lie off by the same: what counts is the distance to where neighbours' displacement would put it.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.codec.anchors import LEAST_SHARE, triangle_of
from sacha_core.codec.places import Places
from sacha_core.codec.template import Template

__all__ = ["search_vertices"]

ROUNDS = 2  # the first knows displacements of triangles, the second of vertices; further ones hardly change anything


def search_vertices(
    binding: Int[np.ndarray, " n"], position: Float[np.ndarray, "n 3"], template: Template
) -> Int[np.ndarray, " n"] | None:
    """Find a vertex for each Gaussian, no two at one.

    Args:
        binding: (n,) triangles.
        position: (n, 3) in their units.
        template: of the head.

    Returns:
        (n,) vertices in coding order; None where a triangle has more Gaussians than vertices, or few vertices would have one.
    """
    owner = triangle_of(template) if template.known else np.zeros(0, np.int64)
    n_faces = len(template.faces)
    there = np.bincount(owner[owner >= 0], minlength=n_faces)
    if not len(owner) or len(binding) < LEAST_SHARE * len(owner):
        return None
    if (np.bincount(binding, minlength=n_faces) > there).any():
        return None
    frames = template.frames(binding)
    turned = np.einsum("ijn,nj->ni", frames.axes, position.astype(np.float64))
    at = 2 * (turned * frames.scale[:, None] + frames.sums / 3)  # half grid cells, as vertices are
    row, place = pairs_of(binding, owner, there)
    moved, known = by_triangle(binding, at, owner, template.vertices)
    for _ in range(ROUNDS):
        target = template.vertices.points + around(template.vertices, moved, known)
        found = nearest_first(row, place, ((at[row] - target[place]) ** 2).sum(axis=1))
        moved, known = np.zeros(target.shape), np.zeros(len(target), bool)
        moved[found], known[found] = at - template.vertices.points[found], True
    return found


def pairs_of(
    binding: Int[np.ndarray, " n"], owner: Int[np.ndarray, " m"], there: Int[np.ndarray, " f"]
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Give each Gaussian with each vertex of its triangle."""
    by_owner = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[by_owner], binding)
    n = there[binding]
    row = np.repeat(np.arange(len(binding)), n)
    step = np.arange(len(row)) - np.repeat(np.cumsum(n) - n, n)
    return row, by_owner[first[row] + step]


def by_triangle(
    binding: Int[np.ndarray, " n"], at: Float[np.ndarray, "n 3"], owner: Int[np.ndarray, " m"], vertices: Places
) -> tuple[Float[np.ndarray, "m 3"], Bool[np.ndarray, " m"]]:
    """Give how far a triangle's Gaussians lie from its vertices on average, for each vertex, and where that is known."""
    n_faces = max(int(owner.max()), int(binding.max())) + 1
    held = owner >= 0
    middles = means_of(owner[held], vertices.points[held].astype(np.float64), n_faces)[0]
    means, counts = means_of(binding, at, n_faces)
    return (means - middles)[owner], held & (counts[owner] > 0)


def means_of(
    group: Int[np.ndarray, " n"], values: Float[np.ndarray, "n 3"], n_groups: int
) -> tuple[Float[np.ndarray, "g 3"], Int[np.ndarray, " g"]]:
    """Give means of groups, and how many each has; 0 of none."""
    counts = np.bincount(group, minlength=n_groups)
    sums = np.stack([np.bincount(group, weights=axis, minlength=n_groups) for axis in values.T], axis=1)
    return sums / np.maximum(counts, 1)[:, None], counts


def around(
    vertices: Places, moved: Float[np.ndarray, "m 3"], known: Bool[np.ndarray, " m"]
) -> Float[np.ndarray, "m 3"]:
    """Give the mean displacement of each vertex' neighbours; its own where none of theirs is known."""
    weight = (vertices.beside >= 0) & known[vertices.beside]
    n = weight.sum(axis=1)
    summed = (moved[vertices.beside] * weight[:, :, None]).sum(axis=1)
    return np.where(n[:, None] > 0, summed / np.maximum(n, 1)[:, None], moved)


def nearest_first(
    row: Int[np.ndarray, " p"], place: Int[np.ndarray, " p"], distance: Float[np.ndarray, " p"]
) -> Int[np.ndarray, " n"]:
    """Pair off whatever is nearest of what is left; each row finds a place, since its triangle has one for each."""
    found, taken = np.full(int(row.max()) + 1, -1), np.zeros(int(place.max()) + 1, bool)
    order = np.argsort(distance, kind="stable")
    for one, vertex in zip(row[order].tolist(), place[order].tolist(), strict=True):
        if found[one] < 0 and not taken[vertex]:
            found[one], taken[vertex] = vertex, True
    return found
