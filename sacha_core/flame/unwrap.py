"""Texture coordinates for heads that bring none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sacha_core.flame.model import HeadModel

__all__ = ["unwrapped"]


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
    import xatlas  # noqa: PLC0415  (compiled, and rarely needed)

    _, uv_faces, uv = xatlas.parametrize(head.v_template.astype(np.float32), head.faces.astype(np.uint32))
    return replace(head, uv=uv.astype(np.float32), uv_faces=uv_faces.astype(np.int32))
