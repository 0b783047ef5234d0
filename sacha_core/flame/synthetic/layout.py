"""How the skin is meshed: a grid around the head in which blocks give way to patches of rings.

A patch is a stack of closed rings of equal length, from the border of its block inwards, closed by a point. Folding the rings makes lids,
lips and the pocket of the mouth, or an ear. Since every patch is a disc, the skin is one sheet with the bottom of the neck as its only
border, and unwraps to a rectangle without a cut but the one down the back.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.synthetic.sizes import Block, Size

__all__ = ["Part", "Patch", "Skin", "lay_out_skin"]

COLUMN_PULL = 0.68  # how much closer columns stand in front than evenly spaced: 0 not at all, towards 1 infinitely


@dataclass(frozen=True)
class Part:
    """A closed piece of its own: an eyeball or a row of teeth.

    Args:
        vertices: (v, 3) metres.
        faces: (f, 3) counter-clockwise seen from outside.
        uv: (u, 2) of the piece alone.
        uv_faces: (f, 3).
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "u 2"]
    uv_faces: Int[np.ndarray, "f 3"]


@dataclass(frozen=True)
class Patch:
    """Rings in place of a block.

    Args:
        rings: (k, m) vertices; ring 0 is the border of the block, which the grid owns.
        cap: the vertex that closes the last ring.
        turn_rad: (m,) angle of each ring position about the middle of the block, 0 away from the middle of the face, pi/2 up.
        mirrored: whether the rings run clockwise, as the mirror image of a patch on the subject's left does.
    """

    rings: Int[np.ndarray, "k m"]
    cap: int
    turn_rad: Float[np.ndarray, " m"]
    mirrored: bool


@dataclass(frozen=True)
class Skin:
    """Vertices of the skin by their place in the grid and its patches, and the triangles between them.

    Args:
        n_vertices: vertices in all.
        grid: (rows + 1, columns) vertices, -1 inside blocks; the first row repeats the pole at the crown.
        angle_rad: (columns,) around the head of each column.
        height: (rows + 1,) height parameter of each row, 0 at the pole.
        patches: by name: left_eye, right_eye, mouth, left_ear, right_ear.
        faces: (f, 3) counter-clockwise seen from outside.
        uv: (u, 2) in the unit square, row 0 at the top.
        uv_faces: (f, 3).
    """

    n_vertices: int
    grid: Int[np.ndarray, "r c"]
    angle_rad: Float[np.ndarray, " c"]
    height: Float[np.ndarray, " r"]
    patches: dict[str, Patch]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "u 2"]
    uv_faces: Int[np.ndarray, "f 3"]


def lay_out_skin(size: Size) -> Skin:
    """Number the vertices of the skin and connect them.

    Args:
        size: resolution.

    Returns:
        The skin's topology; no positions yet.

    Source: own.
    """
    mesh = _Numbering(size)
    half = size.n_columns // 2
    blocks = {
        "left_eye": (size.eye, size.eye_rings, False),
        "right_eye": (size.eye, size.eye_rings, True),
        "mouth": (size.mouth, size.mouth_rings, False),
        "left_ear": (size.ear, size.ear_rings, False),
        "right_ear": (size.ear, size.ear_rings, True),
    }
    for block, _, mirrored in blocks.values():
        mesh.open_block(block, mirrored)
    mesh.number_grid()
    patches = {name: mesh.add_patch(block, len(rings), mirrored) for name, (block, rings, mirrored) in blocks.items()}
    turn = 2 * np.pi * (np.arange(size.n_columns) - half) / size.n_columns
    return Skin(
        n_vertices=mesh.n_vertices,
        grid=mesh.grid,
        angle_rad=turn - COLUMN_PULL * np.sin(turn),
        height=np.array([0.0, *size.rows]),
        patches=patches,
        faces=np.array(mesh.faces, np.int32),
        uv=np.array(mesh.uv),
        uv_faces=np.array(mesh.uv_faces, np.int32),
    )


class _Numbering:
    """The mesh while it grows: columns are counted from the back, `middle` is the column of the nose."""

    def __init__(self, size: Size) -> None:
        self.n_rows, self.n_columns, self.middle = len(size.rows), size.n_columns, size.n_columns // 2
        self.grid = np.zeros((self.n_rows + 1, self.n_columns), np.int32)
        self.cell_open = np.zeros((self.n_rows, self.n_columns), bool)
        self.faces: list[tuple[int, int, int]] = []
        self.uv: list[tuple[float, float]] = []
        self.uv_faces: list[tuple[int, int, int]] = []
        self.n_vertices = 0

    def open_block(self, block: Block, mirrored: bool) -> None:
        first, last = self._columns(block, mirrored)
        self.cell_open[block.rows[0] : block.rows[1], first:last] = True
        self.grid[block.rows[0] + 1 : block.rows[1], first + 1 : last] = -1

    def number_grid(self) -> None:
        kept = self.grid[1:] >= 0
        self.grid[1:][kept] = 1 + np.arange(kept.sum())
        self.n_vertices = 1 + int(kept.sum())
        # In the unwrapped sheet the back column stands at both ends, and the pole is a whole row.
        self.uv = [
            (c / self.n_columns, 1 - r / self.n_rows) for r in range(self.n_rows + 1) for c in range(self.n_columns + 1)
        ]
        for row in range(self.n_rows):
            for column in range(self.n_columns):
                if not self.cell_open[row, column]:
                    self._add_cell(row, column)

    def add_patch(self, block: Block, n_rings: int, mirrored: bool) -> Patch:
        border, turn = _border(block)
        if mirrored:
            border = [(row, -column) for row, column in border]
        loop = [(row, column + self.middle) for row, column in border]
        m = len(loop)
        rings = np.empty((n_rings + 1, m), np.int32)
        rings[0] = [self.grid[row, column % self.n_columns] for row, column in loop]
        rings[1:] = self.n_vertices + np.arange(n_rings * m).reshape(n_rings, m)
        cap = self.n_vertices + n_rings * m
        self.n_vertices = cap + 1
        uv_rings = np.empty_like(rings)
        uv_rings[0] = [self._uv_of_grid(row, column) for row, column in loop]
        corners = np.array([self.uv[i] for i in uv_rings[0]])
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        for k in range(1, n_rings + 1):
            uv_rings[k] = len(self.uv) + np.arange(m)
            self.uv += [tuple(p) for p in centre + (corners - centre) * (1 - k / (n_rings + 1))]
        uv_cap = len(self.uv)
        self.uv.append(tuple(centre))
        self._stitch(rings, cap, uv_rings, uv_cap, mirrored, turn)
        return Patch(rings, cap, turn, mirrored)

    def _columns(self, block: Block, mirrored: bool) -> tuple[int, int]:
        first, last = block.columns
        return (self.middle - last, self.middle - first) if mirrored else (self.middle + first, self.middle + last)

    def _uv_of_grid(self, row: int, column: int) -> int:
        return row * (self.n_columns + 1) + column

    def _add_cell(self, row: int, column: int) -> None:
        nearer, further = (row, column), (row, column + 1)
        below, across = (row + 1, column), (row + 1, column + 1)
        if row == 0:
            triangles = [((0, column), below, across)]
        elif column < self.middle:  # the diagonals of the two halves mirror each other
            triangles = [(nearer, below, further), (further, below, across)]
        else:
            triangles = [(nearer, below, across), (nearer, across, further)]
        for triangle in triangles:
            self.faces.append(tuple(int(self.grid[r, c % self.n_columns]) for r, c in triangle))  # type: ignore[arg-type]
            self.uv_faces.append(tuple(self._uv_of_grid(r, c) for r, c in triangle))  # type: ignore[arg-type]

    def _stitch(
        self,
        rings: Int[np.ndarray, "k m"],
        cap: int,
        uv_rings: Int[np.ndarray, "k m"],
        uv_cap: int,
        mirrored: bool,
        turn: Float[np.ndarray, " m"],
    ) -> None:
        m = rings.shape[1]
        for ids, closing, out in ((rings, cap, self.faces), (uv_rings, uv_cap, self.uv_faces)):
            for j in range(m):
                i = (j + 1) % m
                slanted = np.cos((turn[j] + turn[i]) / 2 if i else turn[j]) > 0
                for outer, inner in itertools.pairwise(ids):
                    a, b, c, d = (int(x) for x in (outer[j], outer[i], inner[i], inner[j]))
                    pair = [(a, b, c), (a, c, d)] if slanted else [(a, b, d), (b, c, d)]
                    out += [t[::-1] if mirrored else t for t in pair]
                last = (int(ids[-1][j]), int(ids[-1][i]), closing)
                out.append(last[::-1] if mirrored else last)


def _border(block: Block) -> tuple[list[tuple[int, int]], Float[np.ndarray, " m"]]:
    """Walk counter-clockwise around a block on the subject's left; give (row, column) and the angle about its middle."""
    (top, bottom), (first, last) = block.rows, block.columns
    walk = [(bottom, c) for c in range(first, last)] + [(r, last) for r in range(bottom, top, -1)]
    walk += [(top, c) for c in range(last, first, -1)] + [(r, first) for r in range(top, bottom)]
    across, up = np.arange(last - first) / (last - first), np.arange(bottom - top) / (bottom - top)
    quarter = np.pi / 2
    turn = np.concatenate([across - 1.5, up - 0.5, across + 0.5, up + 1.5]) * quarter
    return walk, turn
