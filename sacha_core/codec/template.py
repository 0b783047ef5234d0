r"""What both sides know of the head: in which order its triangles are best coded, and how large each is.

Neighbours on the head look alike, so triangles are put in the order of a space-filling curve through their centroids; and steps are meant
in metres, while attributes come in triangle units, so each triangle has a size class in half octaves. Both follow from the unposed
template by integer arithmetic, or float64 operations that are exact or rounded once, hence alike on every machine.

Without the head, triangles keep the order of the head's faces and are all of one size.

Source: own; the curve is Hilbert's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Template", "template_of", "unknown_template"]

GRID_BITS = 20  # vertices are rounded to 2^20 cells across the head
CURVE_BITS = 10  # of each coordinate in the curve


@dataclass(frozen=True)
class Template:
    """Order and size of the f triangles.

    Args:
        order: (f,) triangles in coding order.
        size: (f,) half octaves of each triangle's size over the middle one's, in coding order.
    """

    order: Int[np.ndarray, " f"]
    size: Int[np.ndarray, " f"]


def unknown_template(n_faces: int) -> Template:
    """Give what is known without the head."""
    return Template(np.arange(n_faces), np.zeros(n_faces, np.int64))


def template_of(v_template: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Template:
    """Give order and sizes of the triangles of an unposed head."""
    corners = on_grid(v_template)[faces]
    sums = corners.sum(axis=1)
    low = sums.min(axis=0, initial=3 << GRID_BITS)
    cells = (sums - low) * (1 << CURVE_BITS) // (3 << GRID_BITS)
    order = np.argsort(curve_index(np.minimum(cells, (1 << CURVE_BITS) - 1)), kind="stable")
    size = size_classes(corners)[order]
    middle = np.sort(size)[len(size) // 2] if len(size) else 0
    return Template(order, size - middle)


def on_grid(v_template: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, "v 3"]:
    """Round vertices to a grid of a power-of-two pitch, 2^19 to 2^20 cells across the longest side, starting at 0."""
    wide = v_template.astype(np.float64)
    low = wide.min(axis=0, initial=np.inf)
    extent = (wide - low).max(initial=0.0)
    octave = int(np.frexp(extent)[1])
    return np.asarray(np.rint(np.ldexp(wide - low, GRID_BITS - octave)).astype(np.int64))


def size_classes(corners: Int[np.ndarray, "f 3 3"]) -> Int[np.ndarray, " f"]:
    """Half octaves of the root of each triangle's area."""
    ax, ay, az = (corners[:, 1] - corners[:, 0]).T
    bx, by, bz = (corners[:, 2] - corners[:, 0]).T
    normal = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    x, y, z = (component.astype(np.float64) for component in normal)
    return np.asarray(np.frexp((x * x + y * y) + z * z)[1].astype(np.int64) >> 1)


def curve_index(cells: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " f"]:
    """Give the place of each cell on the Hilbert curve, on which consecutive cells touch.

    Source: Skilling, Programming the Hilbert curve, 2004: undo the reflections and exchanges of each level, then Gray-decode.
    """
    x = [cells[:, axis].astype(np.int64) for axis in range(3)]
    for bit in range(CURVE_BITS - 1, 0, -1):
        below = (1 << bit) - 1
        for axis in range(3):
            high = (x[axis] >> bit & 1) == 1
            swap = np.where(high, 0, (x[0] ^ x[axis]) & below)
            x[0] ^= np.where(high, below, swap)
            x[axis] ^= swap
    x[1] ^= x[0]
    x[2] ^= x[1]
    flip = np.zeros(len(cells), np.int64)
    for bit in range(CURVE_BITS - 1, 0, -1):
        flip ^= (x[2] >> bit & 1) * ((1 << bit) - 1)
    place = np.zeros(len(cells), np.int64)
    for bit in range(CURVE_BITS):
        for axis in range(3):
            place |= ((x[axis] ^ flip) >> bit & 1) << (3 * bit + 2 - axis)
    return place
