"""Teeth for FLAME, which has none: two rows of 84 triangles behind the lips, as GaussianAvatars adds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel

__all__ = [
    "FLAME_FACES",
    "FLAME_VERTICES",
    "LOWER_LIP",
    "N_TEETH_FACES",
    "N_TEETH_VERTICES",
    "UPPER_LIP",
    "add_teeth",
    "is_flame",
]

FLAME_VERTICES, FLAME_FACES = 5023, 9976
# Outer rings of the lips, corresponding vertices from the subject's left to right
UPPER_LIP = (1713, 1715, 1716, 1735, 1696, 1694, 1657, 3543, 2774, 2811, 2813, 2850, 2833, 2832, 2830)
LOWER_LIP = (1576, 1577, 1773, 1774, 1795, 1802, 1865, 3503, 2948, 2905, 2898, 2881, 2880, 2713, 2712)
N = len(UPPER_LIP)
HALF = 7  # columns on either side of the middle, where diagonals are mirrored
NECK, JAW = 1, 2  # joints that carry the upper and the lower teeth

# First vertex of each row of 15
ROWS = range(0, 8 * N, N)
UPPER_ROOT, LOWER_ROOT, UPPER_EDGE, LOWER_EDGE, UPPER_ROOT_BACK, UPPER_EDGE_BACK, LOWER_ROOT_BACK, LOWER_EDGE_BACK = (
    ROWS
)
UPPER_ROWS = (UPPER_ROOT, UPPER_EDGE, UPPER_ROOT_BACK, UPPER_EDGE_BACK)
N_TEETH_VERTICES = 8 * N
# Strips between two rows p and q, each column two triangles; corners are 0: p[n], 1: p[n+1], 2: q[n], 3: q[n+1].
# The order of strips and triangles is that of published avatars: bindings are indices into it.
STRIPS = (
    (UPPER_ROOT, UPPER_EDGE, ((0, 3, 2), (0, 1, 3)), ((0, 1, 2), (1, 3, 2))),
    (UPPER_ROOT_BACK, UPPER_EDGE_BACK, ((0, 2, 3), (0, 3, 1)), ((0, 2, 1), (1, 2, 3))),
    (UPPER_EDGE_BACK, UPPER_EDGE, ((0, 2, 1), (1, 2, 3)), ((0, 2, 3), (0, 3, 1))),
    (LOWER_EDGE, LOWER_ROOT, ((0, 1, 2), (1, 3, 2)), ((0, 3, 2), (0, 1, 3))),
    (LOWER_ROOT_BACK, LOWER_EDGE_BACK, ((0, 3, 2), (0, 1, 3)), ((0, 1, 2), (1, 3, 2))),
    (LOWER_EDGE_BACK, LOWER_EDGE, ((0, 1, 2), (1, 3, 2)), ((0, 3, 2), (0, 1, 3))),
)  # fmt: skip
N_TEETH_FACES = len(STRIPS) * 2 * (N - 1)
UV_CORNER, UV_SIZE = (0.002, 0.97), 0.028  # a square that FLAME's texture layout leaves free


def is_flame(head: HeadModel) -> bool:
    """Tell whether a head has FLAME's own number of vertices and triangles, with teeth or without."""
    teeth = int(head.n_teeth_faces == N_TEETH_FACES)
    expected = (FLAME_VERTICES + teeth * N_TEETH_VERTICES, FLAME_FACES + teeth * N_TEETH_FACES)
    return (head.n_vertices, head.n_faces) == expected


def add_teeth(head: HeadModel) -> HeadModel:
    """Give FLAME's head with teeth: 5143 vertices and 10144 triangles, the new ones last.

    Upper teeth move with the neck joint, lower ones with the jaw; identity moves a column as it moves the lips in front of it; expression
    and pose correctives leave it.

    Raises:
        HeadError: the head is not FLAME's, has teeth, or has no jaw.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 4; the table of its public FLAME layer.
    """
    if not is_flame(head) or head.n_teeth_faces:
        raise HeadError(
            f"teeth fit FLAME's head of {FLAME_VERTICES} vertices and {FLAME_FACES} triangles without teeth;"
            f" {head.name!r} has {head.n_vertices}, {head.n_faces}, and {head.n_teeth_faces} teeth triangles"
        )
    if len(head.parents) <= JAW:
        raise HeadError(f"teeth need a jaw to move with; head {head.name!r} has {len(head.parents)} joints")
    columns = (head.shapedirs[list(UPPER_LIP)] + head.shapedirs[list(LOWER_LIP)]) / 2
    weights = np.zeros((8, N, len(head.parents)), head.weights.dtype)
    for row, first in enumerate(ROWS):
        weights[row, :, NECK if first in UPPER_ROWS else JAW] = 1

    def still(directions: Float[np.ndarray, "v 3 k"]) -> Float[np.ndarray, "w 3 k"]:
        return np.concatenate([directions, np.zeros((N_TEETH_VERTICES, *directions.shape[1:]), directions.dtype)])

    faces = teeth_faces().astype(head.faces.dtype)
    return replace(
        head,
        v_template=np.concatenate([head.v_template, teeth_vertices(head.v_template)]),
        faces=np.concatenate([head.faces, faces + FLAME_VERTICES]),
        shapedirs=np.concatenate([head.shapedirs, np.tile(columns, (8, 1, 1))]),
        exprdirs=still(head.exprdirs),
        posedirs=None if head.posedirs is None else still(head.posedirs),
        J_regressor=np.pad(head.J_regressor, ((0, 0), (0, N_TEETH_VERTICES))),
        weights=np.concatenate([head.weights, weights.reshape(-1, len(head.parents))]),
        uv=None if head.uv is None else np.concatenate([head.uv, _teeth_uv().astype(head.uv.dtype)]),
        uv_faces=None
        if head.uv is None or head.uv_faces is None
        else np.concatenate([head.uv_faces, faces + len(head.uv)]),
        n_teeth_faces=N_TEETH_FACES,
    )


def teeth_vertices(v_template: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "120 3"]:
    """Place the teeth behind the lips of the mean head; all lengths are multiples of the mean distance between the lips."""
    upper, lower = v_template[list(UPPER_LIP)].astype(np.float64), v_template[list(LOWER_LIP)].astype(np.float64)
    gap = float(np.linalg.norm(upper - lower, axis=1).mean())
    middle = (upper + lower) / 2
    middle[:, 1] = middle[:, 1].mean()
    middle[:, 2] -= 1.5 * gap

    def moved(points: Float[np.ndarray, "15 3"], y: float = 0.0, z: float = 0.0) -> Float[np.ndarray, "15 3"]:
        shifted: np.ndarray = points + np.array([0.0, y * gap, z * gap])
        return shifted

    upper_edge, lower_edge = moved(middle, y=0.1), moved(middle, y=-0.1, z=-0.4)
    upper_root, lower_root = moved(upper_edge, y=2.0), moved(lower_edge, y=-2.0)
    back = {"z": -1.0}
    rows = {
        UPPER_ROOT: upper_root,
        LOWER_ROOT: lower_root,
        UPPER_EDGE: upper_edge,
        LOWER_EDGE: lower_edge,
        UPPER_ROOT_BACK: moved(upper_root, **back),
        UPPER_EDGE_BACK: moved(upper_edge, **back),
        LOWER_ROOT_BACK: moved(lower_root, **back),
        LOWER_EDGE_BACK: moved(lower_edge, **back),
    }
    return np.concatenate([rows[first] for first in ROWS]).astype(v_template.dtype, copy=False)


def teeth_faces() -> Int[np.ndarray, "168 3"]:
    """List the triangles of the teeth, vertices counted from the first of the teeth."""
    triangles = []
    for p, q, left, right in STRIPS:
        for n in range(N - 1):
            corners = (p + n, p + n + 1, q + n, q + n + 1)
            triangles += [[corners[i] for i in triangle] for triangle in (left if n < HALF else right)]
    return np.array(triangles)


def _teeth_uv() -> Float[np.ndarray, "120 2"]:
    column, row = np.meshgrid(np.linspace(0, UV_SIZE, N), np.linspace(0, UV_SIZE, 8))
    return np.stack([column, row], axis=-1).reshape(-1, 2) + UV_CORNER
