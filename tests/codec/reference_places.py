"""Where Gaussians may lie and in which passes they are decoded, in plain Python, written from FORMAT.md alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from reference_axes import Axes, Point

Trusted = list[tuple[int, int]]  # row and trust of each neighbour or mate


@dataclass
class Places:
    """Places of one kind, by number in coding order.

    Args:
        triangle: the triangle of each; -1 for none.
        point: three integers each.
        beside: list of places beside each.
        middle: whether it is the middle of an edge.
        own: what number it has without that order.
    """

    triangle: list[int]
    point: list[Point]
    beside: list[list[int]]
    middle: list[bool]
    own: list[int] = field(default_factory=list)


@dataclass
class Head:
    """What is known of the head.

    Args:
        triangles: as places.
        vertices: as places, None without the head.
        z: size class of each triangle.
        corners: grid coordinates of the corners of each triangle.
        axes: of each triangle.
    """

    triangles: Places
    vertices: Places | None
    z: list[int]
    corners: list[list[Point]]
    axes: list[Axes]


def curve_index(cell: Sequence[int]) -> int:
    """Place of a cell on the curve."""
    x = list(cell)
    for b in range(9, 0, -1):
        mask = (1 << b) - 1
        for a in range(3):
            if x[a] >> b & 1:
                x[0] ^= mask
            else:
                swap = (x[0] ^ x[a]) & mask
                x[0] ^= swap
                x[a] ^= swap
    x[1] ^= x[0]
    x[2] ^= x[1]
    w = 0
    for b in range(9, 0, -1):
        w ^= ((1 << b) - 1) * (x[2] >> b & 1)
    return int("".join(str((value ^ w) >> b & 1) for b in range(9, -1, -1) for value in x), 2)


def grid_of(vertices: np.ndarray) -> list[Point]:
    """Step 1."""
    wide = vertices.astype(float) - vertices.astype(float).min(axis=0)
    octave = math.frexp(wide.max())[1]
    return [tuple(round(math.ldexp(float(x), 20 - octave)) for x in vertex) for vertex in wide]


def total(points: Sequence[Point]) -> Point:
    """Sum of points."""
    return tuple(map(sum, zip(*points, strict=True)))


def reordered(
    order: list[int], triangle: list[int], points: list[Point], beside: list[list[int]], middle: list[bool]
) -> Places:
    """Number places by their order."""
    number = {one: i for i, one in enumerate(order)}
    return Places(
        [triangle[one] for one in order],
        [points[one] for one in order],
        [[number[other] for other in beside[one]] for one in order],
        [middle[one] for one in order],
        order,
    )


def size_classes(scales: list[float]) -> list[int]:
    """Step 4."""
    classes = []
    for k in scales:
        squared = k * k
        fourth = squared * squared
        classes.append(math.frexp(fourth * fourth)[1])
    middle = sorted(classes)[len(classes) // 2]
    return [one - middle for one in classes]


def known_head(vertices: np.ndarray, faces: np.ndarray) -> Head:
    """Places of a file with flag 2."""
    grid, triangles = grid_of(vertices), faces.tolist()
    corners = [[grid[vertex] for vertex in face] for face in triangles]
    sums = [total(triangle) for triangle in corners]
    low = [min(axis) for axis in zip(*sums, strict=True)]
    cells = [[min((x - y) * 1024 // (3 << 20), 1023) for x, y in zip(one, low, strict=True)] for one in sums]
    # step 5
    sides: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face, ends in enumerate(triangles):
        for i in range(3):
            a, b = ends[i], ends[(i + 1) % 3]
            sides.setdefault((min(a, b), max(a, b)), []).append((face, i))
    edges = sorted(sides)
    counted = {edge: on[:2] for edge, on in sides.items()}
    edge_of = {side: edge for edge, on in sides.items() for side in on}
    beside = []
    for face in range(len(triangles)):
        others = []
        for i in range(3):
            on = counted[edge_of[face, i]]
            if (face, i) in on:
                others += [other for other, j in on if (other, j) != (face, i)]
        beside.append(others)
    order = sorted(range(len(cells)), key=lambda face: (curve_index(cells[face]), face))
    places = reordered(order, list(range(len(triangles))), sums, beside, [False] * len(triangles))
    axes = [Axes(three) for three in corners]
    z = size_classes([one.scale for one in axes])
    return Head(places, vertices_of(grid, triangles, edges, counted, edge_of), z, corners, axes)


def vertices_of(grid: list[Point], triangles: list[list[int]], edges: list, counted: dict, edge_of: dict) -> Places:
    """Steps 6 and 7."""
    v = len(grid)
    number = {edge: v + i for i, edge in enumerate(edges)}
    points = [tuple(2 * x for x in point) for point in grid] + [total((grid[a], grid[b])) for a, b in edges]
    beside = [sorted({b if a == one else a for a, b in edges if one in (a, b)})[:10] for one in range(v)]
    for edge in edges:
        mine = list(edge)
        for face, i in counted[edge]:
            mine.append(triangles[face][(i + 2) % 3])
            mine += [number[edge_of[face, (i + 1) % 3]], number[edge_of[face, (i + 2) % 3]]]
        beside.append(mine)
    triangle = [-1] * len(points)
    for j in range(3):
        lowest: dict[int, int] = {}
        for face in range(len(triangles)):
            for one in (triangles[face][j], number[edge_of[face, j]], number[edge_of[face, (j + 2) % 3]]):
                lowest.setdefault(one, face)
        triangle = [lowest.get(one, -1) if face < 0 else face for one, face in enumerate(triangle)]
    cells = [[min(x >> 11, 1023) for x in point] for point in points]
    order = sorted(range(len(points)), key=lambda one: (curve_index(cells[one]), one))
    return reordered(order, triangle, points, beside, [one >= v for one in range(len(points))])


def unknown_head(f: int) -> Head:
    """Places of a file without flag 2."""
    triangles = Places(list(range(f)), [(i, 0, 0) for i in range(f)], [[] for _ in range(f)], [False] * f)
    return Head(triangles, None, [0] * f, [[(0, 0, 0)] * 3] * f, [Axes([(0, 0, 0)] * 3)] * f)


def nearest(places: Places, x: int, known: set[int]) -> Trusted:
    """Nearest known places of a place, and how far each is trusted."""
    before = [one for one in range(x - 1, -1, -1) if one in known][:2]
    behind = [one for one in range(x + 1, len(places.point)) if one in known][:2]
    candidates = [*before[::-1], *behind, *(one for one in places.beside[x] if one in known and one != x)]

    def far(one: int) -> int:
        return sum((a - b) ** 2 for a, b in zip(places.point[one], places.point[x], strict=True))

    ordered = sorted(candidates, key=far)
    kept = [one for i, one in enumerate(ordered) if i == 0 or one != ordered[i - 1]][:4]
    if not kept:
        return []
    ratios = [(far(kept[0]) + 1) * 1024 // (far(one) + 1) for one in kept]
    trust = [64 * r // sum(ratios) for r in ratios]
    trust[0] += 64 - sum(trust)
    return list(zip(kept, trust, strict=True))


@dataclass
class Pass:
    """Gaussians that are decoded together.

    Args:
        kind: 0 to 3.
        rows: which.
        near: neighbours of each, with their trust.
        mates: mates of each, with theirs.
    """

    kind: int
    rows: list[int]
    near: list[Trusted]
    mates: list[Trusted]


def coarse_to_fine(m: int) -> list[tuple[int, list[int]]]:
    """Kinds and members of the passes over m slots."""
    passes = [(0, [0])] if m else []
    half = (1 << (m - 1).bit_length()) // 2 if m else 0
    while half:
        passes.append(({1: 2, 2: 1}.get(half, 0), list(range(half, m, 2 * half))))
        half //= 2
    return [one for one in passes if one[1]]


def first_passes(places: Places, occupied: list[int], by_vertex: bool) -> list[Pass]:
    """Passes over the firsts of occupied places; rows and neighbours are places."""
    if by_vertex:
        own = [one for one in occupied if not places.middle[one]]
        middles = [one for one in occupied if places.middle[one]]
        last = 1 if len(own) > 1 else None
        plan = [(0, [own[i] for i in members]) for _, members in coarse_to_fine(len(own))]
        if last is not None:
            plan[-1] = (1, plan[-1][1])
        plan += [(2, middles[::2]), (2, middles[1::2])]
    else:
        plan = [(kind, [occupied[i] for i in members]) for kind, members in coarse_to_fine(len(occupied))]
    passes, known = [], set[int]()
    for kind, members in plan:
        if members:
            passes.append(Pass(kind, members, [nearest(places, one, known) for one in members], [[] for _ in members]))
            known |= set(members)
    return passes


def all_passes(places: Places, numbers: list[int], by_vertex: bool) -> list[Pass]:
    """Passes over all Gaussians."""
    occupied = [one for one, number in enumerate(numbers) if number]
    first = dict(zip(occupied, np.cumsum([0, *(numbers[one] for one in occupied)]).tolist(), strict=False))

    def rows(trusted: Trusted) -> Trusted:
        return [(first[one], trust) for one, trust in trusted]

    passes = [
        Pass(one.kind, [first[place] for place in one.rows], [rows(near) for near in one.near], one.mates)
        for one in first_passes(places, occupied, by_vertex)
    ]
    around = {one: rows(nearest(places, one, set(occupied))) for one in occupied if numbers[one] > 1}
    low = 1
    while low < max(numbers, default=0):
        width = max(1, (1 << (low.bit_length() - 1)) // 2)
        members = [(place, rank) for place in occupied for rank in range(low, min(low + width, numbers[place]))]
        mates = [[first[place] + low - 1 - i for i in range(min(low, 8))] for place, _ in members]
        trusted = [[(row, 64 // len(m) + (64 % len(m) if i == 0 else 0)) for i, row in enumerate(m)] for m in mates]
        passes.append(
            Pass(3, [first[place] + rank for place, rank in members], [around[place] for place, _ in members], trusted)
        )
        low += width
    return passes


def mean(values: Sequence[int], trusted: Trusted) -> int:
    """Mean over a list of neighbours or mates."""
    return (sum(values[row] * trust for row, trust in trusted) + 32) >> 6 if trusted else 0
