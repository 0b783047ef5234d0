"""Edges of a mesh of triangles, and what lies beside what.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

__all__ = ["Edges", "edges_of"]

NOBODY = -1
MOST_AROUND = 10  # neighbours of a vertex that count


@dataclass(frozen=True)
class Edges:
    """The edges of v vertices and f triangles.

    Args:
        ends: (e, 2) vertices, ascending; edges in lexicographic order.
        of_face: (f, 3) the edges from corner 0 to 1, 1 to 2 and 2 to 0 of each triangle.
        sides: (e, 2) the first two sides on each edge, ascending, as 3 * triangle + side (as in `of_face`); -1 where there is no second.
        n_vertices: v.
        corners: (f, 3) vertices of each triangle.
    """

    ends: Int[np.ndarray, "e 2"]
    of_face: Int[np.ndarray, "f 3"]
    sides: Int[np.ndarray, "e 2"]
    n_vertices: int
    corners: Int[np.ndarray, "f 3"]

    @property
    def across(self) -> Int[np.ndarray, "f 3"]:
        """Triangle on the other side of each side, -1 where there is none."""
        mine = np.arange(self.of_face.size).reshape(-1, 3)
        first, second = self.sides[self.of_face, 0], self.sides[self.of_face, 1]
        other = np.where(first == mine, second, np.where(second == mine, first, NOBODY))
        return np.asarray(np.where(other == NOBODY, NOBODY, other // 3))

    @property
    def around(self) -> Int[np.ndarray, "v b"]:
        """Vertices that each vertex shares an edge with, ascending, the first ten; -1 where there are fewer."""
        start, end = np.concatenate([self.ends, self.ends[:, ::-1]]).T
        order = np.lexsort((end, start))
        start, end = start[order], end[order]
        number = np.arange(len(start)) - np.searchsorted(start, start)
        kept = number < MOST_AROUND
        table = np.full((self.n_vertices, MOST_AROUND), NOBODY)
        table[start[kept], number[kept]] = end[kept]
        return table

    @property
    def beside(self) -> Int[np.ndarray, "e 8"]:
        """What is beside the middle of each edge: its ends; then, for its two sides, the opposite corner and the triangle's other edges.

        Vertices count from 0, middles of edges from v; -1 where there is no second side.
        """
        columns = [self.ends]
        for side in self.sides.T:
            triangle, number = side // 3, side % 3
            opposite = self.corners[triangle, (number + 2) % 3]
            others = [self.n_vertices + self.of_face[triangle, (number + turn) % 3] for turn in (1, 2)]
            columns.append(np.where(side[:, None] == NOBODY, NOBODY, np.stack([opposite, *others], axis=1)))
        return np.concatenate(columns, axis=1)


def edges_of(faces: Int[np.ndarray, "f 3"], n_vertices: int) -> Edges:
    """Find the edges of triangles."""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    low, high = sides.min(axis=1), sides.max(axis=1)
    keys, edge = np.unique(low * n_vertices + high, return_inverse=True)
    order = np.argsort(edge, kind="stable")
    begin = np.searchsorted(edge[order], np.arange(len(keys)))
    count = np.bincount(edge, minlength=len(keys))
    second = np.where(count > 1, order[np.minimum(begin + 1, max(len(order) - 1, 0))], NOBODY)
    ends = np.stack([keys // max(n_vertices, 1), keys % max(n_vertices, 1)], axis=1)
    return Edges(ends, edge.reshape(-1, 3), np.stack([order[begin], second], axis=1), n_vertices, faces)
