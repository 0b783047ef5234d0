"""The head model: a mesh with blend shapes, joints and skinning weights, as FLAME defines it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

__all__ = ["JOINTS", "HeadModel", "HeadReference"]

JOINTS = ("root", "neck", "jaw", "left_eye", "right_eye")


@dataclass(frozen=True)
class HeadReference:
    """Which head an avatar needs, without the head itself.

    Args:
        name: what people call it.
        sha256: hexadecimal digest over its canonical arrays.
        n_vertices: number of vertices.
        n_faces: number of triangles.
    """

    name: str
    sha256: str
    n_vertices: int
    n_faces: int


@dataclass(frozen=True)
class HeadModel:
    """A head prior with v vertices, f triangles, j joints, s identity and e expression components. Metres, float32.

    Args:
        name: what people call it.
        v_template: (v, 3) unposed mean head.
        faces: (f, 3) counter-clockwise seen from outside.
        shapedirs: (v, 3, s) identity directions.
        exprdirs: (v, 3, e) expression directions.
        J_regressor: (j, v) joint positions from the shaped vertices.
        weights: (v, j) skinning weights; rows sum to 1.
        parents: (j,) parent of each joint, -1 for the root; order of `JOINTS`, of which a rig may have only the first few.
        posedirs: (v, 3, 9 (j - 1)) pose correctives, or None.
        uv: (u, 2) texture coordinates, or None.
        uv_faces: (f, 3) indices into `uv`, or None.
        masks: vertex indices by region name, FLAME's official names (`face`, `lips`, `left_eyeball`, ...).
        n_teeth_faces: how many of the last triangles are teeth (168 where the teeth of GaussianAvatars were added, else 0).

    Source: Li et al., FLAME, SIGGRAPH Asia 2017.
    """

    name: str
    v_template: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    shapedirs: Float[np.ndarray, "v 3 s"]
    exprdirs: Float[np.ndarray, "v 3 e"]
    J_regressor: Float[np.ndarray, "j v"]
    weights: Float[np.ndarray, "v j"]
    parents: Int[np.ndarray, " j"]
    posedirs: Float[np.ndarray, "v 3 p"] | None = None
    uv: Float[np.ndarray, "u 2"] | None = None
    uv_faces: Int[np.ndarray, "f 3"] | None = None
    masks: dict[str, Int[np.ndarray, " m"]] = field(default_factory=dict)
    n_teeth_faces: int = 0

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.v_template)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def reference(self) -> HeadReference:
        """Name, size and SHA-256 over the canonical arrays: those that change where a posed vertex or a triangle lies."""
        digest = hashlib.sha256()
        for name in ("v_template", "faces", "shapedirs", "exprdirs", "J_regressor", "weights", "parents", "posedirs"):
            array = getattr(self, name)
            if array is None:
                continue
            kind = "<i4" if np.issubdtype(array.dtype, np.integer) else "<f4"
            digest.update(f"{name} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array, kind).tobytes())
        return HeadReference(self.name, digest.hexdigest(), self.n_vertices, self.n_faces)
