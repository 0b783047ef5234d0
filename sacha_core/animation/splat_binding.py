"""Gaussians that stand in the world onto the triangles of a head, which then carry them: how splats of other programs become an avatar."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.animation.kernels.nearest import nearest_triangles
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import triangle_frames

__all__ = ["Subdivision", "bound_to", "nearest_binding", "subdivided", "with_colours_as_harmonics"]

CLUSTER = 32  # triangles; as many clusters as triangles in one at some thousand
SH_0 = 0.28209479177387814


@dataclass(frozen=True)
class Subdivision:
    """A head's skin, once subdivided: its vertices and then the middles of its edges.

    Args:
        edges: (e, 2) ends of each edge, the smaller index first, ascending.
        binding: (v + e,) a triangle of the head that each of these lies on.
    """

    edges: Int[np.ndarray, "e 2"]
    binding: Int[np.ndarray, " n"]

    def points(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "n 3"]:
        """Give the subdivided mesh's vertices for a pose of the head; those of teeth are not among them."""
        n = len(self.binding) - len(self.edges)
        return np.concatenate([vertices[:n], (vertices[self.edges[:, 0]] + vertices[self.edges[:, 1]]) / 2])


def subdivided(head: HeadModel) -> Subdivision:
    """Subdivide a head's skin as LAM does (FLAME: 5,023 vertices and 14,995 middles of edges make 20,018).

    A vertex is bound to the first triangle that has it as its first corner, else as its second, else as its third; the middle of an edge to
    the first with that edge at its first corner, else at its second: the order in which the subdivided mesh lists its triangles.

    Source: He et al., LAM, SIGGRAPH 2025; the order of PyTorch3D's subdivision, which published avatars on this mesh follow.
    """
    skin = head.faces[: head.n_faces - head.n_teeth_faces].astype(np.int64)
    n_vertices = int(skin.max()) + 1
    sides = np.sort(np.stack([skin[:, [0, 1]], skin[:, [1, 2]], skin[:, [2, 0]]]), axis=2)
    edges, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middle = n_vertices + number.reshape(3, -1)  # of each triangle's three sides
    blocks = [
        (skin[:, 0], middle[0], middle[2]),
        (skin[:, 1], middle[0], middle[1]),
        (skin[:, 2], middle[1], middle[2]),
    ]
    binding = np.full(n_vertices + len(edges), -1, np.int64)
    for block in reversed(blocks):
        for face in range(len(skin) - 1, -1, -1):
            binding[[corner[face] for corner in block]] = face
    alone = np.flatnonzero(binding < 0)  # vertices that no triangle uses
    binding[alone] = 0
    return Subdivision(edges.astype(np.int32), binding.astype(np.int32))


def nearest_binding(
    points: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Find the triangle nearest to each point, the one of lowest index where several are.

    Args:
        points: (n, 3) metres.
        vertices: (v, 3) of the posed head, metres.
        faces: (f, 3) its triangles.

    Returns:
        (n,) triangles, and (n,) how far they are, metres.
    """
    corners = vertices[faces].astype(np.float64)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    starts = np.arange(0, len(faces) + CLUSTER, CLUSTER).clip(max=len(faces))
    starts = starts[: int(np.searchsorted(starts, len(faces))) + 1]
    sizes = np.diff(starts)
    cluster_centres = np.add.reduceat(centres, starts[:-1]) / sizes[:, None]
    reach = np.linalg.norm(centres - np.repeat(cluster_centres, sizes, axis=0), axis=1) + radii
    cluster_radii = np.maximum.reduceat(reach, starts[:-1])
    found, squared = np.empty(len(points), np.int64), np.empty(len(points))
    nearest_triangles(
        points.astype(np.float64),
        corners.reshape(-1, 9),
        centres,
        radii,
        starts,
        cluster_centres,
        cluster_radii,
        found,
        squared,
    )
    return found.astype(np.int32), np.sqrt(squared)


def bound_to(
    gaussians: Gaussians,
    binding: Int[np.ndarray, " n"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Gaussians:
    """Give Gaussians of the world in the local units of triangles: the inverse of `sacha_core.avatar.binding.to_world`.

    Args:
        gaussians: in metres of the world.
        binding: (n,) the triangle that shall carry each.
        vertices: (v, 3) of the head in the pose in which the Gaussians stand, metres.
        faces: (f, 3) its triangles.

    Raises:
        FormatError: a Gaussian is so far from its triangle, or so much larger, that float32 cannot hold it.
        GeometryError: a triangle has zero area.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4, solved for the local values.
    """
    frames = triangle_frames(vertices.astype(np.float64), faces)
    scale, rotation = frames.scale[binding], frames.rotation[binding]
    local = np.einsum("nji,nj->ni", rotation, gaussians.position - frames.origin[binding]) / scale[:, None]
    back = quaternion.from_matrix(frames.rotation)[binding] * [1, -1, -1, -1]
    turned = quaternion.multiply(back, quaternion.normalise(gaussians.quaternion.astype(np.float64)))
    with np.errstate(over="ignore"):
        bound = replace(
            gaussians,
            position=local.astype(np.float32),
            log_scale=(gaussians.log_scale - np.log(scale)[:, None]).astype(np.float32),
            quaternion=turned.astype(np.float32),
            binding=binding.astype(np.int32),
        )
    if not np.isfinite(bound.position).all():
        row = int(np.argmin(np.isfinite(bound.position).all(axis=1)))
        raise FormatError(
            f"Gaussian {row} at {gaussians.position[row].tolist()} is too far from the head to be bound to it"
        )
    return bound


def with_colours_as_harmonics(gaussians: Gaussians) -> Gaussians:
    """Give Gaussians whose `f_dc` were colours, from 0 to 1, as LAM's are, with the harmonics of degree 0 that give these colours."""
    return replace(gaussians, sh_dc=((gaussians.sh_dc - 0.5) / SH_0).astype(np.float32))
