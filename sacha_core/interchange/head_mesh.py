"""A head's mesh as other programs write it, OBJ, PLY or glTF: vertices and triangles in the file's own order, which is what binding needs.

Mesh libraries split vertices at texture seams and drop those that no triangle uses, so OBJ is read here; PLY has neither trap. glTF itself
keeps a vertex for each of its texture coordinates: who knows the head's triangles can join them again (`sacha_core.scene.topology`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import FormatError
from sacha_core.npz import as_float32

__all__ = ["SUFFIXES", "HeadMesh", "read_head_mesh"]

MAX_INDEX = 2**31 - 1


@dataclass(frozen=True)
class HeadMesh:
    """A surface in one pose.

    Args:
        vertices: (v, 3) in the file's order and units, float32.
        faces: (f, 3) vertex indices in the file's order, int32.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


def read_head_mesh(path: Path) -> HeadMesh:
    """Read the vertices and triangles of an `.obj`, `.ply`, `.glb` or `.gltf` file; polygons are cut into fans.

    Of a glTF scene it is the mesh with the most triangles, where its node puts it.

    Raises:
        FormatError: it is no such file, has no triangle, an index out of range, or a coordinate that is not finite.
        OSError: it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise FormatError(f"{path.name} is no mesh that can be read here; expected {' or '.join(READERS)}")
    mesh = READERS[suffix](path)
    if not len(mesh.faces):
        raise FormatError(f"{path.name} holds no triangles")
    if not np.isfinite(mesh.vertices).all():
        vertex = int(np.argmin(np.isfinite(mesh.vertices).all(axis=1)))
        raise FormatError(f"vertex {vertex} of {path.name} is not finite")
    outside = (mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))
    if outside.any():
        face, corner = np.argwhere(outside)[0]
        raise FormatError(
            f"triangle {face} of {path.name} uses vertex {mesh.faces[face, corner]}; it has vertices 0 to {len(mesh.vertices) - 1}"
        )
    return mesh


def _read_obj(path: Path) -> HeadMesh:
    """Read the `v` and `f` lines of an OBJ; whatever else it holds does not change the surface."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            kind, *words = line.split() or [""]
            try:
                if kind == "v":
                    x, y, z = map(float, words[:3])
                    vertices.append([x, y, z])
                elif kind == "f":
                    corners = [_obj_index(word, len(vertices)) for word in words]
                    faces += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
            except (ValueError, IndexError) as error:
                raise FormatError(
                    f"line {number} of {path.name} is no {kind!r} line of an OBJ: {line.strip()[:60]!r}"
                ) from error
    return HeadMesh(as_float32(np.array(vertices, np.float64).reshape(-1, 3)), np.array(faces, np.int32).reshape(-1, 3))


def _obj_index(corner: str, n_vertices: int) -> int:
    """Give the vertex of a corner like `7/12/3`; OBJ counts from 1, or backwards from the latest vertex."""
    index = int(corner.split("/", 1)[0])
    if index == 0 or abs(index) > MAX_INDEX:
        raise ValueError("OBJ counts from 1, and a mesh has fewer than 2^31 vertices")
    return index - 1 if index > 0 else n_vertices + index


def _read_ply(path: Path) -> HeadMesh:
    """Read a PLY by trimesh, untouched."""
    import trimesh  # noqa: PLC0415  (heavy, and rarely needed)

    try:
        with path.open("rb") as file:
            mesh: Any = trimesh.load(file, file_type="ply", process=False, force="mesh")
        return HeadMesh(as_float32(np.array(mesh.vertices, np.float64)), np.array(mesh.faces, np.int32))
    except OSError:
        raise
    except Exception as error:  # hostile bytes can make a foreign reader raise anything
        raise FormatError(f"{path.name} is no PLY mesh: {error}") from error


def _read_gltf(path: Path) -> HeadMesh:
    """Read the largest mesh of a glTF scene by trimesh, untouched but for its node's place."""
    import trimesh  # noqa: PLC0415  (heavy, and rarely needed)

    try:
        scene: Any = trimesh.load_scene(path, process=False)
        meshes = [mesh for mesh in scene.dump(concatenate=False) if hasattr(mesh, "faces")]
        largest = max(meshes, key=lambda mesh: len(mesh.faces))
        return HeadMesh(as_float32(np.array(largest.vertices, np.float64)), np.array(largest.faces, np.int32))
    except OSError:
        raise
    except Exception as error:  # hostile bytes can make a foreign reader raise anything
        raise FormatError(f"{path.name} is no glTF with a mesh: {error}") from error


READERS = {".obj": _read_obj, ".ply": _read_ply, ".glb": _read_gltf, ".gltf": _read_gltf}
SUFFIXES = tuple(READERS)
