"""Texture coordinates for heads that bring none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.model import HeadModel

__all__ = ["unwrap", "unwrapped"]


def unwrap(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "u 2"], Int[np.ndarray, "f 3"]]:
    """Give texture coordinates to a mesh: charts that do not overlap and fill the unit square.

    Args:
        vertices: (v, 3) metres.
        faces: (f, 3) vertex indices.

    Returns:
        Coordinates (u, 2) float32, and (f, 3) int32 indices into them; triangles keep their places.

    Source: xatlas (Young), after thekla_atlas.
    """
    import xatlas  # noqa: PLC0415  (compiled, and rarely needed)

    _, uv_faces, uv = xatlas.parametrize(vertices.astype(np.float32), faces.astype(np.uint32))
    return uv.astype(np.float32), uv_faces.astype(np.int32)


def unwrapped(head: HeadModel) -> HeadModel:
    """Give the head with texture coordinates, by which anything known of its triangles can be painted into an image.

    Charts do not overlap and fill the unit square; a triangle keeps its place, a vertex on a seam gets several coordinates. The head's
    SHA-256 stays: where a point is painted moves no vertex.

    Args:
        head: any head; one that has coordinates is given back as it is.

    Source: xatlas (Young), after thekla_atlas.
    """
    if head.uv is not None:
        return head
    uv, uv_faces = unwrap(head.v_template, head.faces)
    return replace(head, uv=uv, uv_faces=uv_faces)
