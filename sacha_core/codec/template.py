r"""What both sides know of the head: where Gaussians can sit, in which order that is best coded, and how large the triangles are.

Neighbours on the head look alike, so triangles are put in the order of a space-filling curve through their centroids; and steps are meant
in metres, while attributes come in triangle units, so each triangle has a size class in eighths of an octave. All follows from the unposed
template by integer arithmetic, or float64 operations that are exact or rounded once, hence alike on every machine.

Without the head, triangles keep the order of the head's faces and are all of one size.

Source: own; the curve is Hilbert's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.frames import RestFrames, frames_of
from sacha_core.codec.mesh import Edges, edges_of
from sacha_core.codec.places import NOWHERE, Places, along_curve

__all__ = ["Template", "template_of", "unknown_template"]

GRID_BITS = 20  # vertices are rounded to 2^20 cells across the head
CURVE_BITS = 10  # of each coordinate in the curve


@dataclass(frozen=True)
class Template:
    """The triangles, and what else is known of the head.

    Args:
        triangles: the f triangles as places, in coding order; points are sums of three corners.
        size: (f,) eighths of an octave of each triangle's scale over the middle one's, in coding order.
        grid: (v, 3) vertices on the grid; none without the head.
        faces: (f, 3) likewise.
        octave: exponent of two that the head's extent is below; the grid's pitch is 2^(octave - GRID_BITS) metres.
    """

    triangles: Places
    size: Int[np.ndarray, " f"]
    grid: Int[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    octave: int = 0

    @property
    def order(self) -> Int[np.ndarray, " f"]:
        """Triangles in coding order."""
        return self.triangles.order

    @property
    def known(self) -> bool:
        """Whether there is a head."""
        return len(self.faces) > 0

    def frames(self, triangles: Int[np.ndarray, " p"]) -> RestFrames:
        """Give the unposed frames of triangles, as the head counts them."""
        return frames_of(self.grid[self.faces[triangles]])

    @cached_property
    def edges(self) -> Edges:
        """Edges of the triangles."""
        return edges_of(self.faces, len(self.grid))

    @cached_property
    def vertices(self) -> Places:
        """Vertices of the once-subdivided mesh as places: the head's own, then the middles of its edges; points in half grid cells."""
        edges = self.edges
        points = np.concatenate([2 * self.grid, self.grid[edges.ends].sum(axis=1)])
        beside = np.full((len(points), max(edges.around.shape[1], edges.beside.shape[1])), NOWHERE)
        beside[: len(self.grid), : edges.around.shape[1]] = edges.around
        beside[len(self.grid) :, : edges.beside.shape[1]] = edges.beside
        cells = np.minimum(points >> (GRID_BITS + 1 - CURVE_BITS), (1 << CURVE_BITS) - 1)
        return along_curve(points, cells, beside)


def unknown_template(n_faces: int) -> Template:
    """Give what is known without the head."""
    points = np.zeros((n_faces, 3), np.int64)
    points[:, 0] = np.arange(n_faces)
    triangles = Places(points, np.arange(n_faces), np.zeros((n_faces, 0), np.int64))
    nothing = np.zeros((0, 3), np.int64)
    return Template(triangles, np.zeros(n_faces, np.int64), nothing, nothing)


def template_of(v_template: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Template:
    """Give order and sizes of the triangles of an unposed head."""
    grid, octave = on_grid(v_template)
    faces = faces.astype(np.int64)
    corners = grid[faces]
    sums = corners.sum(axis=1)
    cells = (sums - sums.min(axis=0, initial=3 << GRID_BITS)) * (1 << CURVE_BITS) // (3 << GRID_BITS)
    triangles = along_curve(sums, np.minimum(cells, (1 << CURVE_BITS) - 1), edges_of(faces, len(grid)).across)
    size = size_classes(corners)[triangles.order]
    middle = np.sort(size)[len(size) // 2] if len(size) else 0
    return Template(triangles, size - middle, grid, faces, octave)


def on_grid(v_template: Float[np.ndarray, "v 3"]) -> tuple[Int[np.ndarray, "v 3"], int]:
    """Round vertices to a grid of a power-of-two pitch, 2^19 to 2^20 cells across the longest side, starting at 0.

    Returns:
        Grid coordinates, and the exponent of two that the longest side is below.
    """
    wide = v_template.astype(np.float64)
    low = wide.min(axis=0, initial=np.inf)
    extent = (wide - low).max(initial=0.0)
    octave = int(np.frexp(extent)[1])
    return np.rint(np.ldexp(wide - low, GRID_BITS - octave)).astype(np.int64), octave


def size_classes(corners: Int[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " f"]:
    """Eighths of an octave of each triangle's scale, rounded down."""
    scale = frames_of(corners).scale
    squared = scale * scale
    fourth = squared * squared
    return np.asarray(np.frexp(fourth * fourth)[1].astype(np.int64))
