"""A head of hair: short at the sides, longer on top, combed away from a side parting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.flame.model import HeadModel
from sacha_core.synthesis.landmarks import Landmarks
from sacha_core.synthesis.strands import Strands

__all__ = ["HairStyle", "grow_hair"]

N_STEPS = 24  # of tracing a strand, before it is resampled
GRID = (48, 96)  # of the skull's radius by direction
N_CLUMPS = 260
BELOW_SCALP = 0.2  # how far the hairline reaches down the forehead, in distances between the eyes
PARTING_WIDTH_M = 0.05  # over which the hair reaches its full height


@dataclass(frozen=True)
class HairStyle:
    """How the hair is cut and combed; lengths in metres.

    Args:
        n_strands: how many.
        points_per_strand: each strand's number of points.
        top_length: of the longest, on the crown.
        side_length: of the shortest, over the ears and at the nape.
        lift: how far the top stands off the skull.
        parting: where the parting is, to the subject's left of the middle.
        radius: half width of a strand; more than a hair's, since one strand stands for many.
    """

    n_strands: int = 4200
    points_per_strand: int = 9
    top_length: float = 0.085
    side_length: float = 0.018
    lift: float = 0.015
    parting: float = 0.026
    radius: float = 0.0011


class Skull:
    """The head as radii around a centre, by direction: what strands are kept outside of.

    Args:
        points: (n, 3) on the surface, dense.
        centre: (3,) inside.
    """

    def __init__(self, points: Float[np.ndarray, "n 3"], centre: Float[np.ndarray, "3"]) -> None:
        self.centre = centre
        rows, columns = GRID
        offset = points - centre
        distance = np.linalg.norm(offset, axis=1)
        row, column = self.cell(offset / distance[:, None])
        grid = np.zeros(GRID)
        np.maximum.at(grid, (row.astype(int), column.astype(int) % columns), distance)
        while (grid == 0).any():
            padded = np.pad(grid, ((1, 1), (0, 0)), mode="edge")
            near = np.stack([np.roll(padded[i : i + rows], j, axis=1) for i in range(3) for j in (-1, 0, 1)])
            mean = near.sum(axis=0) / np.maximum((near > 0).sum(axis=0), 1)
            grid = np.where(grid == 0, mean, grid)
        self.grid = grid

    def cell(self, direction: Float[np.ndarray, "*n 3"]) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Give row and column of directions in the grid, with fractions."""
        rows, columns = GRID
        row = np.arccos(np.clip(direction[..., 1], -1, 1)) / np.pi * rows
        column = (np.arctan2(direction[..., 0], direction[..., 2]) / (2 * np.pi) + 0.5) * columns
        return np.clip(row, 0, rows - 1e-6), np.clip(column, 0, columns - 1e-6)

    def radius(self, direction: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Give the surface's distance from the centre, between cells linearly."""
        rows, columns = GRID
        row, column = self.cell(direction)
        row, column = np.clip(row - 0.5, 0, rows - 1), column - 0.5
        r, c = np.floor(row).astype(int), np.floor(column).astype(int)
        a, b = row - r, column - c
        below, right = np.minimum(r + 1, rows - 1), (c + 1) % columns
        g, c = self.grid, c % columns
        upper = g[r, c] * (1 - b) + g[r, right] * b
        lower = g[below, c] * (1 - b) + g[below, right] * b
        radius: np.ndarray = upper * (1 - a) + lower * a
        return radius


def above_hairline(points: Float[np.ndarray, "n 3"], landmarks: Landmarks) -> Float[np.ndarray, " n"]:
    """Give how surely points are high enough for hair, 0 to 1: above the ears in front of them, above the lobes behind."""
    low, middle, high = landmarks.ears.mean(axis=0)
    behind = smooth((middle[2] - points[:, 2]) / (0.9 * landmarks.spacing) + 0.25)
    line = (0.35 * middle[1] + 0.65 * high[1]) * (1 - behind) + (low[1] - 0.1 * landmarks.spacing) * behind
    return smooth((points[:, 1] - line) / (0.25 * landmarks.spacing))


def grow_hair(
    head: HeadModel,
    vertices: Float[np.ndarray, "v 3"],
    landmarks: Landmarks,
    colour: Float[np.ndarray, "3"],
    style: HairStyle,
    rng: np.random.Generator,
) -> Strands:
    """Grow the hair of an unposed head.

    Args:
        head: its scalp mask says where hair grows.
        vertices: (v, 3) of the unposed mesh, metres.
        landmarks: of the same head.
        colour: linear RGB.
        style: cut and comb.
        rng: of chance.
    """
    faces, roots = scatter(head, vertices, landmarks, style.n_strands, rng)
    grown = rng.uniform(size=len(roots)) < above_hairline(roots, landmarks) ** 2
    faces, roots = faces[grown], roots[grown]
    scalp = vertices[head.masks["scalp"]]
    centre = np.array([0.0, landmarks.eyes[:, 1].mean() + 0.02, (scalp[:, 2].min() + scalp[:, 2].max()) / 2])
    skull = Skull(surface_samples(head, vertices, landmarks), centre)
    top, bottom = scalp[:, 1].max(), landmarks.ears[:, 0, 1].mean()
    rise = smooth((roots[:, 1] - bottom) / (top - bottom)) ** 1.4  # 0 at the height of the lobes, 1 on the crown
    length = (style.side_length + (style.top_length - style.side_length) * rise) * rng.uniform(0.8, 1.1, len(roots))
    # Where a strand lies between the skull, 0, and the outside, 1: half of them outside, for a smooth outline.
    layer = np.minimum(rng.uniform(0.25, 1.75, len(roots)), rng.uniform(0.92, 1.0, len(roots)))
    path = trace(roots, length, layer, skull, style)
    path, clump = clumped(path, roots, layer, style, rng)
    steps = np.linspace(0, N_STEPS, style.points_per_strand).round().astype(int)
    points = path[:, steps]
    along = np.linspace(0, 1, style.points_per_strand)
    radii = (
        style.radius * np.interp(along, [0, 0.15, 0.6, 1], [0.7, 1, 0.9, 0.15]) * rng.uniform(0.7, 1.2, (len(roots), 1))
    )
    outward = points - skull.centre
    normals = outward / np.linalg.norm(outward, axis=2, keepdims=True)
    tone = 1 + 0.12 * rng.standard_normal(N_CLUMPS)[clump] + 0.05 * rng.standard_normal(len(roots))
    tone = np.clip(tone, 0.65, 1.4)[:, None] * np.interp(along, [0, 0.5, 1], [0.8, 1.0, 1.15])
    exposure = (0.35 + 0.65 * layer)[:, None] * np.interp(along, [0, 0.4], [0.6, 1.0])
    albedo = tone[..., None] * colour
    return Strands(faces, points, radii, albedo, normals, exposure)


def surface_samples(
    head: HeadModel, vertices: Float[np.ndarray, "v 3"], landmarks: Landmarks
) -> Float[np.ndarray, "n 3"]:
    """Give points all over the head above the nape, without the ears: what hair must stay outside of."""
    ears = np.zeros(head.n_vertices, bool)
    ears[head.masks["left_ear"]] = ears[head.masks["right_ear"]] = True
    weights = np.array([[a, b, 4 - a - b] for a in range(5) for b in range(5 - a)]) / 4
    corners = vertices[head.faces[~ears[head.faces].any(axis=1)]].astype(np.float64)
    points = np.einsum("wk,fkc->fwc", weights, corners).reshape(-1, 3)
    floor = landmarks.ears[:, 0, 1].min() - 0.5 * landmarks.spacing
    high: np.ndarray = points[points[:, 1] > floor]
    return high


def smooth(t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Rise smoothly from 0 at 0 to 1 at 1."""
    t = np.clip(t, 0, 1)
    risen: np.ndarray = t * t * (3 - 2 * t)
    return risen


def hairy(head: HeadModel, vertices: Float[np.ndarray, "v 3"], landmarks: Landmarks) -> Bool[np.ndarray, " v"]:
    """Say where on the mesh hair can grow: on the scalp, and on the uppermost forehead, where FLAME's mask of it is bald."""
    grows = np.zeros(head.n_vertices, bool)
    grows[head.masks["scalp"]] = True
    for name in ("neck", "left_ear", "right_ear", "boundary"):
        grows[head.masks[name]] = False
    forehead = head.masks["forehead"]
    hairline = vertices[forehead, 1].max() - BELOW_SCALP * landmarks.spacing
    grows[forehead[vertices[forehead, 1] > hairline]] = True
    return grows


def scatter(
    head: HeadModel, vertices: Float[np.ndarray, "v 3"], landmarks: Landmarks, n: int, rng: np.random.Generator
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Give n places on the scalp, evenly by area: their triangles and points."""
    candidates = np.flatnonzero(hairy(head, vertices, landmarks)[head.faces].all(axis=1))
    corners = vertices[head.faces[candidates]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    shares = (np.arange(n) + rng.uniform(size=n)) / n  # one in each n-th of the area
    chosen = np.minimum(np.searchsorted(np.cumsum(area) / area.sum(), shares), len(candidates) - 1)
    root, turn = np.sqrt(rng.uniform(size=n)), rng.uniform(size=n)
    weights = np.stack([1 - root, root * (1 - turn), root * turn], axis=1)
    return candidates[chosen], np.einsum("nk,nkc->nc", weights, corners[chosen])


def trace(
    roots: Float[np.ndarray, "n 3"],
    length: Float[np.ndarray, " n"],
    layer: Float[np.ndarray, " n"],
    skull: Skull,
    style: HairStyle,
) -> Float[np.ndarray, "n m 3"]:
    """Follow the comb from each root: sideways from the parting, back from the forehead, and down.

    The hair is a shell whose thickness depends on the place, thin at the parting; each strand soon rises to its layer in it.
    """
    path = np.empty((len(roots), N_STEPS + 1, 3))
    path[:, 0] = roots
    here = roots - skull.centre
    ground = np.linalg.norm(here, axis=1) - skull.radius(here / np.linalg.norm(here, axis=1, keepdims=True))
    side = np.where(roots[:, 0] > style.parting, 1.0, -1.0)
    for k in range(1, N_STEPS + 1):
        outward = here / np.linalg.norm(here, axis=1, keepdims=True)
        front = smooth(outward[:, 2] + 0.3)
        top = smooth(outward[:, 1] * 1.4)
        comb = np.stack(
            [
                side * (0.12 + 0.5 * top * (0.3 + 0.7 * front)),
                -0.25 - 0.9 * (1 - top),
                -0.35 - 0.55 * front - 0.3 * top,
            ],
            axis=1,
        )
        comb -= outward * np.einsum("nc,nc->n", comb, outward)[:, None]
        comb /= np.linalg.norm(comb, axis=1, keepdims=True)
        here = here + comb * (length / N_STEPS)[:, None]
        outward = here / np.linalg.norm(here, axis=1, keepdims=True)
        s = k / N_STEPS
        thickness = (0.2 + 0.8 * top) * (0.2 + 0.8 * smooth(np.abs(here[:, 0] - style.parting) / PARTING_WIDTH_M))
        above = ground * (1 - s) + style.lift * thickness * layer * (1 - np.exp(-6 * s)) * (1 - 0.5 * s**2)
        here = outward * (skull.radius(outward) + above)[:, None]
        path[:, k] = skull.centre + here
    return path


def clumped(
    path: Float[np.ndarray, "n m 3"],
    roots: Float[np.ndarray, "n 3"],
    layer: Float[np.ndarray, " n"],
    style: HairStyle,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "n m 3"], Int[np.ndarray, " n"]]:
    """Draw strands towards the nearest guide on their side of the parting, more so towards the tips; give also each one's guide."""
    guides = rng.choice(len(path), min(N_CLUMPS, len(path)), replace=False)
    squared = (roots**2).sum(axis=1)[:, None] - 2 * roots @ roots[guides].T + (roots[guides] ** 2).sum(axis=1)
    left = roots[:, 0] > style.parting
    squared[left[:, None] != left[guides]] = np.inf
    clump = np.argmin(squared, axis=1)
    along = np.linspace(0, 1, path.shape[1])
    pull = (0.55 * along**1.2)[None, :, None] * (0.4 + 0.6 * layer)[:, None, None]
    return path + pull * (path[guides][clump] - path), clump
