"""Axes of triangles and turns, in plain Python, written from FORMAT.md alone: "Axes", "Rotation"."""

from __future__ import annotations

import math
from collections.abc import Sequence

Point = tuple[int, int, int]
Quaternion = tuple[float, float, float, float]


class Axes:
    """Section "Axes": of a triangle, from its corners on the grid."""

    def __init__(self, corners: list[Point]) -> None:
        self.columns: list[Sequence[float]] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        self.scale = 1.0
        e, d = ([y - x for x, y in zip(corners[0], end, strict=True)] for end in corners[1:])
        m = [e[1] * d[2] - e[2] * d[1], e[2] * d[0] - e[0] * d[2], e[0] * d[1] - e[1] * d[0]]
        length, area = (math.sqrt((float(x * x) + float(y * y)) + float(z * z)) for x, y, z in (e, m))
        if area:
            a, b = [x / length for x in e], [x / area for x in m]
            third = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
            self.columns, self.scale = [a, b, third], (length + area / length) * 0.5

    def at(self, i: int, j: int) -> float:
        """R_ij."""
        return self.columns[j][i]

    def quaternion(self) -> Quaternion:
        """The same turn."""
        r = self.at
        squares = [1 + r(0, 0) + r(1, 1) + r(2, 2), 1 + r(0, 0) - r(1, 1) - r(2, 2)]
        squares += [1 - r(0, 0) + r(1, 1) - r(2, 2), 1 - r(0, 0) - r(1, 1) + r(2, 2)]
        row = squares.index(max(squares))
        t = math.sqrt(squares[row])
        own = t * t
        a, b, c = r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)
        d, e, f = r(1, 0) + r(0, 1), r(0, 2) + r(2, 0), r(2, 1) + r(1, 2)
        chosen = ((own, a, b, c), (a, own, d, e), (b, d, own, f), (c, e, f, own))[row]
        return tuple(one / (2 * t) for one in chosen)


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Product of two quaternions."""
    w, x, y, z = p
    s, i, j, k = q
    return (
        w * s - x * i - y * j - z * k,
        w * i + x * s + y * k - z * j,
        w * j - x * k + y * s + z * i,
        w * k + x * j - y * i + z * s,
    )


def likeness(q: Quaternion, r: Quaternion) -> Quaternion:
    """Likeness of q to r."""
    w, x, y, z = q
    best, largest = q, -1.0
    for one in (q, (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)):
        dot = one[0] * r[0] + one[1] * r[1] + one[2] * r[2] + one[3] * r[3]
        if abs(dot) > largest:
            best, largest = tuple(-c for c in one) if dot < 0 else one, abs(dot)
    return best
