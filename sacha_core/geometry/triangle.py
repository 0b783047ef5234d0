"""The frames of triangles, by which bound Gaussians follow a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import GeometryError

__all__ = ["TriangleFrames", "degenerate_limit", "refuse_triangle", "triangle_frames"]


@dataclass(frozen=True)
class TriangleFrames:
    """A similarity transform for each of f triangles: x_world = scale * rotation @ x_local + origin.

    Args:
        rotation: (f, 3, 3) columns: first edge, normal, and their cross product, which points away from the third vertex.
        scale: (f,) mean of the first edge's length and the height over it, metres.
        origin: (f, 3) centroid, metres.
    """

    rotation: Float[np.ndarray, "f 3 3"]
    scale: Float[np.ndarray, " f"]
    origin: Float[np.ndarray, "f 3"]


def degenerate_limit(dtype: np.dtype[np.floating]) -> float:
    """Give the sine of a corner at or under which a triangle's normal is rounding noise in `dtype`."""
    return 16 * float(np.finfo(dtype).eps)


def triangle_frames(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> TriangleFrames:
    r"""Frame of each triangle.

    With first edge $e = v_1 - v_0$, second $h = v_2 - v_0$ and $c = e \times h$: rotation $[\hat e \mid \hat c \mid \hat e \times \hat c]$,
    scale $(|e| + |c| / |e|) / 2$, origin the centroid. Works on separate components, which vectorise better than rows of three.

    Args:
        vertices: (v, 3) posed mesh vertices, metres.
        faces: (f, 3) vertex indices, counter-clockwise seen from outside.

    Returns:
        f frames in the dtype of `vertices`; `rotation` is proper (det = +1) to rounding.

    Raises:
        GeometryError: a face has zero area, or one too small to be told from it, or a vertex that is not finite; the message names the
            first such face.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
    """
    components = np.ascontiguousarray(vertices.T)
    p0, p1, p2 = (components[:, np.ascontiguousarray(faces[:, corner])] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused by name
        edge, second = p1 - p0, p2 - p0
        normal = _cross(edge, second)
        edge_squared, normal_squared = _dot(edge, edge), _dot(normal, normal)
        limit = degenerate_limit(vertices.dtype) ** 2 * edge_squared * _dot(second, second)
        sound = (normal_squared > limit) & (normal_squared < np.inf)
        smallest = np.finfo(vertices.dtype).tiny  # a smaller square has lost digits to underflow
        sound &= (normal_squared >= smallest) & (edge_squared >= smallest)
    if not sound.all():
        refuse_triangle(vertices, faces, int(np.argmin(sound)))
    edge_length, normal_length = np.sqrt(edge_squared), np.sqrt(normal_squared)
    edge /= edge_length
    normal /= normal_length
    rotation = np.empty((len(faces), 3, 3), vertices.dtype)
    for column, axis in enumerate((edge, normal, _cross(edge, normal))):
        rotation[:, :, column] = axis.T
    scale = (edge_length + normal_length / edge_length) * vertices.dtype.type(0.5)
    return TriangleFrames(rotation, scale, np.ascontiguousarray((p0 + p1 + p2).T) / vertices.dtype.type(3))


def _cross(a: Float[np.ndarray, "3 f"], b: Float[np.ndarray, "3 f"]) -> Float[np.ndarray, "3 f"]:
    out = np.empty_like(a)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i])
    return out


def _dot(a: Float[np.ndarray, "3 f"], b: Float[np.ndarray, "3 f"]) -> Float[np.ndarray, " f"]:
    product: np.ndarray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def refuse_triangle(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], face: int) -> None:
    """Raise the error that a degenerate triangle is.

    Raises:
        GeometryError: always; the message names the triangle, what is wrong with it, and where its vertices lie.
    """
    corners = vertices[faces[face]]
    fault = (
        _fault(corners.astype(np.float64), vertices.dtype)
        if np.isfinite(corners).all()
        else "has a vertex that is not finite"
    )
    where = ", ".join(
        f"{index} at ({x:.6g}, {y:.6g}, {z:.6g})" for index, (x, y, z) in zip(faces[face], corners, strict=True)
    )
    raise GeometryError(f"triangle {face} {fault}: vertices {where}; every triangle needs an area to carry Gaussians")


def _fault(corners: Float[np.ndarray, "3 3"], dtype: np.dtype[np.floating]) -> str:
    """Say why a triangle of finite vertices has no frame in a dtype."""
    edge, second = corners[1] - corners[0], corners[2] - corners[0]
    lengths = np.linalg.norm(edge), np.linalg.norm(second)
    if np.linalg.norm(np.cross(edge, second)) > degenerate_limit(dtype) * lengths[0] * lengths[1]:
        return f"has an edge of {lengths[0]:.3g} m, out of range for {dtype}"
    return "has zero area"
