"""The head model: a mesh with blend shapes, joints and skinning weights, as FLAME defines it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import HeadError

__all__ = ["JOINTS", "HeadModel", "HeadReference"]

JOINTS = ("root", "neck", "jaw", "left_eye", "right_eye")
MAX_FACES = 1 << 24  # the index of a face is stored as float32 in PLY files, exact below this
WEIGHT_SUM_TOLERANCE = 1e-3  # float32 rounding of published weights is 1e-6; worse means that they are not normalised


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
        expression_names: name of each expression component, or none.

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
    expression_names: tuple[str, ...] = ()

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

    def validate(self) -> None:
        """Check that all arrays fit together, every number is finite, and every index names something.

        Raises:
            HeadError: naming the array, the first offender, and what was expected.
        """
        v, f, j = len(self.v_template), len(self.faces), len(self.parents)
        if not 1 <= j <= len(JOINTS):
            raise HeadError(f"head {self.name!r} has {j} joints, expected 1 to {len(JOINTS)}: {', '.join(JOINTS)}")
        if v < 3 or not 1 <= f <= MAX_FACES:
            raise HeadError(
                f"head {self.name!r} has {v} vertices and {f} triangles, expected at least one triangle, at most {MAX_FACES}"
            )
        self._check_shapes({
            "v_template": (v, 3), "faces": (f, 3), "shapedirs": (v, 3, None), "exprdirs": (v, 3, None), "J_regressor": (j, v),
            "weights": (v, j), "parents": (j,), "posedirs": (v, 3, 9 * (j - 1)), "uv": (None, 2), "uv_faces": (f, 3),
        })  # fmt: skip
        self._check_indices()
        unsummed = np.abs(self.weights.sum(axis=1, dtype=np.float64) - 1) > WEIGHT_SUM_TOLERANCE
        if unsummed.any():
            row = int(np.argmax(unsummed))
            raise HeadError(
                f"skinning weights of vertex {row} of head {self.name!r} sum to {self.weights[row].sum():.6g}, expected 1"
            )
        if not 0 <= self.n_teeth_faces <= f:
            raise HeadError(f"head {self.name!r} claims {self.n_teeth_faces} teeth triangles of {f}")
        if len(set(self.expression_names)) not in {0, self.exprdirs.shape[2]}:
            raise HeadError(
                f"head {self.name!r} has {len(set(self.expression_names))} different names of expressions,"
                f" but directions for {self.exprdirs.shape[2]}"
            )

    def _check_shapes(self, expected: dict[str, tuple[int | None, ...]]) -> None:
        for name, shape in expected.items():
            array = getattr(self, name)
            if array is None and name in {"posedirs", "uv", "uv_faces"}:
                continue
            kind = np.integer if name in {"faces", "parents", "uv_faces"} else np.floating
            if not isinstance(array, np.ndarray) or not np.issubdtype(array.dtype, kind):
                raise HeadError(f"{name} of head {self.name!r} is not an array of {kind.__name__} numbers")
            agrees = array.ndim == len(shape) and all(
                want in {None, got} for want, got in zip(shape, array.shape, strict=True)
            )
            if not agrees:
                wanted = ", ".join("any" if want is None else str(want) for want in shape)
                raise HeadError(f"{name} of head {self.name!r} has shape {array.shape}, expected ({wanted})")
            if not np.isfinite(array).all():
                row = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
                raise HeadError(f"{name} of head {self.name!r} is not finite at row {row}")

    def _check_indices(self) -> None:
        lists: dict[str, tuple[np.ndarray | None, int]] = {"faces": (self.faces, self.n_vertices)}
        lists["uv_faces"] = (self.uv_faces, 0 if self.uv is None else len(self.uv))
        lists |= {f"mask {name!r}": (mask, self.n_vertices) for name, mask in self.masks.items()}
        for name, (indices, bound) in lists.items():
            if indices is None or indices.size == 0:
                continue
            if not np.issubdtype(indices.dtype, np.integer) or (name.startswith("mask") and indices.ndim != 1):
                raise HeadError(f"{name} of head {self.name!r} is not a list of indices")
            outside = (indices < 0) | (indices >= bound)
            if outside.any():
                row, value = int(np.argmax(outside.reshape(len(indices), -1).any(axis=1))), int(indices[outside][0])
                raise HeadError(
                    f"{name} of head {self.name!r} has index {value} in row {row}, expected 0 to {bound - 1}"
                )
        if self.parents[0] != -1 or any(not 0 <= parent < child for child, parent in enumerate(self.parents[1:], 1)):
            raise HeadError(
                f"parents of head {self.name!r} are {self.parents.tolist()}, expected -1 first and then an earlier joint for each"
            )
