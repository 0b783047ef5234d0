"""A finer surface than the head's own mesh: subdivided, and rounded between its vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.synthesis.kernels.surface import curved_midpoints, vertex_normals

__all__ = ["FineSurface", "subdivide"]

ROUNDNESS = np.float32(0.5)  # of Phong tessellation; at 1/2 the middle of a short arc of a circle lies on the circle


@dataclass(frozen=True)
class FineSurface:
    """Topology of a mesh after some rounds of splitting each triangle in four.

    Vertices of a coarser mesh keep their numbers, and triangle i came from triangle i // 4**len(edges) of the coarsest.

    Args:
        faces: triangles of each round, coarsest (the mesh itself) first.
        edges: for each round the edges (e, 2) on whose middles its new vertices lie.
    """

    faces: tuple[Int[np.ndarray, "_ 3"], ...]
    edges: tuple[Int[np.ndarray, "_ 2"], ...]

    def interpolate(self, values: Float[np.ndarray, "v ..."]) -> Float[np.ndarray, "w ..."]:
        """Carry values of the mesh's vertices to the fine vertices, linearly."""
        for edges in self.edges:
            values = np.concatenate([values, (values[edges[:, 0]] + values[edges[:, 1]]) / 2])
        return values

    def refine(
        self, vertices: Float[np.ndarray, "v 3"], rounds: int | None = None
    ) -> tuple[Float[np.ndarray, "w 3"], Float[np.ndarray, "w 3"]]:
        """Give positions and unit normals of the fine vertices of a posed mesh.

        Args:
            vertices: (v, 3) of the mesh, metres.
            rounds: how many of the rounds; all by default.

        Source: Boubekeur and Alexa, Phong tessellation, SIGGRAPH Asia 2008.
        """
        points = np.ascontiguousarray(vertices, np.float32)
        normals = np.empty_like(points)
        vertex_normals(points, self.faces[0], normals)
        for edges, faces in list(zip(self.edges, self.faces[1:], strict=True))[:rounds]:
            midpoints = np.empty((len(edges), 3), np.float32)
            curved_midpoints(points, normals, edges, ROUNDNESS, midpoints)
            points = np.concatenate([points, midpoints])
            normals = np.empty_like(points)
            vertex_normals(points, faces, normals)
        return points, normals


def subdivide(faces: Int[np.ndarray, "f 3"], n_vertices: int, rounds: int) -> FineSurface:
    """Split every triangle in four, several times.

    Args:
        faces: (f, 3).
        n_vertices: of the mesh.
        rounds: how often.
    """
    levels, all_edges = [np.ascontiguousarray(faces, np.int32)], []
    for _ in range(rounds):
        corners = levels[-1].astype(np.int64)
        following = corners[:, [1, 2, 0]]
        low, high = np.minimum(corners, following), np.maximum(corners, following)
        keys, which = np.unique(low * n_vertices + high, return_inverse=True)
        middle = n_vertices + which.reshape(-1, 3)  # of the edges ab, bc, ca
        (a, b, c), (ab, bc, ca) = corners.T, middle.T
        finer = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
        all_edges.append(np.stack([keys // n_vertices, keys % n_vertices], axis=1).astype(np.int32))
        levels.append(finer.astype(np.int32))
        n_vertices += len(keys)
    return FineSurface(tuple(levels), tuple(all_edges))
