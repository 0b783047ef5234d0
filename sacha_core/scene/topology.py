"""A mesh as the head whose triangles it has, also where its file keeps vertices apart at texture seams, as glTF does."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.errors import TopologyError
from sacha_core.flame.model import HeadModel
from sacha_core.interchange.head_mesh import HeadMesh

__all__ = ["as_the_heads", "misfit"]

SAME_PLACE = 1e-6  # of the mesh's extent: copies of a vertex are written from the same float32
LIKELY_SIZES = (0.5, 2.0)  # of a mesh against its head: people's heads differ by a tenth, units by ten and more
LIKELY_TURN_DEG = 45.0  # of a mesh against its head: people turn their heads less, other axes are 90 or 180 apart


def misfit(mesh: HeadMesh, head: HeadModel) -> str | None:
    """Tell why a mesh of a head's triangles cannot be moved as the head is: it has other units or axes; None where it can.

    Source: Kabsch, Acta Crystallographica A32, 1976, for the rotation between two sets of points.
    """
    own, others = (points - points.mean(axis=0) for points in (mesh.vertices, head.v_template[: len(mesh.vertices)]))
    own, others = own.astype(np.float64), others.astype(np.float64)
    size = np.linalg.norm(own) / np.linalg.norm(others)
    if not LIKELY_SIZES[0] <= size <= LIKELY_SIZES[1]:
        return f"it is {size:.3g} times as large as head {head.name!r}, which is in metres"
    left, _, right = np.linalg.svd(own.T @ others)
    rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    turn = float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))
    if turn > LIKELY_TURN_DEG:
        return f"it is turned by {turn:.0f} degrees against head {head.name!r}, whose y points up and z forward"
    return None


def as_the_heads(name: str, mesh: HeadMesh, head: HeadModel) -> HeadMesh:
    """Give a mesh with the head's own vertices, or the first of them: teeth come last, and a mesh may lack them.

    Args:
        name: of the mesh, for messages.
        mesh: whose triangles are the head's in the head's order.
        head: the head.

    Raises:
        TopologyError: it has other triangles.
    """
    n_faces = len(mesh.faces)
    wrong = TopologyError(
        f"mesh {name!r} with {n_faces} triangles does not have those of head {head.name!r} with {head.n_faces}, in its order"
    )
    if n_faces not in {head.n_faces, head.n_faces - head.n_teeth_faces}:
        raise wrong
    faces = head.faces[:n_faces]
    if len(mesh.vertices) <= head.n_vertices and np.array_equal(mesh.faces, faces):
        return mesh
    joined = _joined(mesh, head)
    apart = np.abs(joined[faces] - mesh.vertices[mesh.faces]).max(initial=0)
    if not apart <= SAME_PLACE * np.ptp(mesh.vertices, axis=0).max():
        raise wrong
    return HeadMesh(joined, faces)


def _joined(mesh: HeadMesh, head: HeadModel) -> Float[np.ndarray, "v 3"]:
    """Give each of the head's vertices the place of one of its copies; one of no triangle has the head's own."""
    faces = head.faces[: len(mesh.faces)]
    joined = head.v_template[: faces.max(initial=-1) + 1].copy()
    joined[faces] = mesh.vertices[mesh.faces]
    return joined
