"""Brows and lashes: short strands on the skin over the eyes and along the lids."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.model import HeadModel
from sacha_core.synthesis.landmarks import Landmarks
from sacha_core.synthesis.strands import Strands

__all__ = ["grow_brows", "grow_lashes"]

# The middle line of a brow from the nose outwards, relative to the eye's centre, in distances between the eyes: outwards, up, half height.
BROW_LINE = np.array(
    [
        [-0.30, 0.300, 0.055],
        [-0.15, 0.335, 0.062],
        [0.05, 0.365, 0.056],
        [0.22, 0.370, 0.042],
        [0.35, 0.335, 0.028],
        [0.44, 0.290, 0.012],
    ]
)
N_BROW = 190  # strands of one brow
BROW_LENGTH_M, BROW_RADIUS_M = 0.0080, 0.00034
UPPER_LASHES, LOWER_LASHES = 34, 14
UPPER_LENGTH_M, LOWER_LENGTH_M, LASH_RADIUS_M = 0.0058, 0.0024, 0.00022


def grow_brows(
    head: HeadModel,
    vertices: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    landmarks: Landmarks,
    colour: Float[np.ndarray, "3"],
    points_per_strand: int,
    rng: np.random.Generator,
) -> Strands:
    """Grow both brows on the unposed head.

    Args:
        head: its triangles.
        vertices: (v, 3) metres.
        normals: (v, 3) unit.
        landmarks: of the same head.
        colour: linear RGB.
        points_per_strand: m.
        rng: of chance.
    """
    front = FrontSide(head, vertices, normals)
    along = np.linspace(0, 1, points_per_strand)
    roots, starts, outs, directions = [], [], [], []
    for eye, side in ((landmarks.eyes[0], 1.0), (landmarks.eyes[1], -1.0)):
        place = (np.arange(N_BROW) + rng.uniform(size=N_BROW)) / N_BROW
        knots = np.linspace(0, 1, len(BROW_LINE))
        outwards, up, half = (np.interp(place, knots, BROW_LINE[:, k]) for k in range(3))
        across = rng.uniform(-1, 1, N_BROW)
        x = eye[0] + side * landmarks.spacing * (outwards + rng.normal(0, 0.006, N_BROW))
        y = eye[1] + landmarks.spacing * (up + half * across)
        face, point, normal = front.at(x, y)
        # Hairs rise near the nose and lie down along the brow further out; both rows lean to its middle.
        lean = np.interp(place, [0, 0.3, 1], [1.1, 0.35, -0.35]) - 0.35 * across + rng.normal(0, 0.12, N_BROW)
        directions.append(np.stack([side * np.cos(lean), np.sin(lean), np.zeros(N_BROW)], axis=1))
        roots.append(face)
        starts.append(point)
        outs.append(normal)
    root_face, start, out = np.concatenate(roots), np.concatenate(starts), np.concatenate(outs)
    direction = np.concatenate(directions)
    direction -= out * np.einsum("sc,sc->s", direction, out)[:, None]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = BROW_LENGTH_M * rng.uniform(0.7, 1.1, len(start))
    points = start[:, None] + (length[:, None] * along)[..., None] * direction[:, None]
    # A head is rounder than a hair is straight: the tips must not sink into the skin.
    points[..., 2] = np.maximum(points[..., 2], front.depth(points[..., 0], points[..., 1]))
    points += out[:, None] * (0.0004 + 0.0007 * np.sin(np.pi * along))[None, :, None]
    radii = BROW_RADIUS_M * np.interp(along, [0, 0.3, 1], [0.8, 1, 0.2]) * np.ones((len(start), 1))
    shape = points.shape
    tone = rng.uniform(0.8, 1.1, (len(start), 1, 1))
    normal = np.broadcast_to(out[:, None], shape)
    return Strands(
        root_face, points, radii, np.broadcast_to(tone * colour * 0.9, shape), normal, np.full(shape[:2], 0.85)
    )


class FrontSide:
    """The surface as seen from in front, without perspective: which triangle lies at (x, y)."""

    def __init__(self, head: HeadModel, vertices: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]) -> None:
        corners = vertices[head.faces].astype(np.float64)
        a, b, c = corners[:, 0, :2], corners[:, 1, :2], corners[:, 2, :2]
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        balls = np.zeros(head.n_vertices, bool)
        balls[head.masks["left_eyeball"]] = balls[head.masks["right_eyeball"]] = True
        self.rows = np.flatnonzero((area > 1e-10) & ~balls[head.faces].any(axis=1))
        self.corners, self.area, self.normals = corners[self.rows], area[self.rows], normals[head.faces[self.rows]]

    def at(
        self, x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Give triangle, point and unit normal of the foremost surface at each place."""
        places = np.stack([x, y], axis=1)
        low, high = self.corners[:, :, :2].min(axis=1), self.corners[:, :, :2].max(axis=1)
        near = np.flatnonzero(((high >= places.min(axis=0)) & (low <= places.max(axis=0))).all(axis=1))
        a, b, c = (self.corners[near, k, :2] for k in range(3))
        weights = np.stack([cross(places, b, c), cross(places, c, a), cross(places, a, b)], axis=2)
        weights /= self.area[near][None, :, None]
        depth = np.einsum("nfk,fk->nf", weights, self.corners[near, :, 2])
        depth[(weights < -1e-6).any(axis=2)] = -np.inf
        best = np.argmax(depth, axis=1)
        chosen = weights[np.arange(len(x)), best]
        point = np.einsum("nk,nkc->nc", chosen, self.corners[near[best]])
        normal = np.einsum("nk,nkc->nc", chosen, self.normals[near[best]])
        return self.rows[near[best]], point, normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def depth(self, x: Float[np.ndarray, "n m"], y: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
        """Give z of the foremost surface at each place."""
        _, point, _ = self.at(x.reshape(-1), y.reshape(-1))
        depth: np.ndarray = point[:, 2].reshape(x.shape)
        return depth


def cross(
    p: Float[np.ndarray, "n 2"], u: Float[np.ndarray, "f 2"], w: Float[np.ndarray, "f 2"]
) -> Float[np.ndarray, "n f"]:
    """Give twice the signed area of the triangles (p, u, w)."""
    px, py = p[:, 0, None], p[:, 1, None]
    doubled: np.ndarray = (u[:, 0] - px) * (w[:, 1] - py) - (u[:, 1] - py) * (w[:, 0] - px)
    return doubled


def grow_lashes(
    head: HeadModel,
    vertices: Float[np.ndarray, "v 3"],
    landmarks: Landmarks,
    colour: Float[np.ndarray, "3"],
    points_per_strand: int,
    rng: np.random.Generator,
) -> Strands:
    """Grow the lashes of all four lids on the unposed head; arguments as for `grow_brows`."""
    balls = np.union1d(head.masks["left_eyeball"], head.masks["right_eyeball"])
    parts = []
    for eye, rim in zip(landmarks.eyes, landmarks.lid_rims, strict=True):
        ring = vertices[rim]
        centre = (ring.min(axis=0) + ring.max(axis=0)) / 2
        side = 1.0 if eye[0] > landmarks.eyes[:, 0].mean() else -1.0
        for upper, count, length in ((True, UPPER_LASHES, UPPER_LENGTH_M), (False, LOWER_LASHES, LOWER_LENGTH_M)):
            lid = rim[(ring[:, 1] > centre[1]) == upper]
            if len(lid) < 2:
                continue
            lid = lid[np.argsort(vertices[lid][:, 0])]
            place = np.linspace(0.06, 0.94, count) * (len(lid) - 1) + rng.normal(0, 0.02, count)
            index = np.clip(place.astype(int), 0, len(lid) - 2)
            part = np.clip(place - index, 0, 1)[:, None]
            start = vertices[lid[index]] * (1 - part) + vertices[lid[index + 1]] * part
            fan = (start[:, 0] - centre[0]) / max(np.ptp(ring[:, 0]), 1e-6) * 2
            outer = 0.5 + 0.5 * side * fan  # lashes are longest at the outer corner
            size = length * (0.6 + 0.5 * outer) * rng.uniform(0.85, 1.1, count)
            along = np.linspace(0, 1, points_per_strand)
            sign = 1.0 if upper else -1.0
            x = fan[:, None] * (0.45 * along + 0.3 * along**2)
            y = sign * (0.15 * along + 0.65 * along**2) - (0.2 * along if upper else 0)
            z = 0.9 * along - 0.35 * along**2
            curve = np.stack([x, np.broadcast_to(y, x.shape), np.broadcast_to(z, x.shape)], axis=2)
            points = start[:, None] + size[:, None, None] * curve
            nearest = lid[np.where(part[:, 0] < 0.5, index, index + 1)]
            roots = face_at(head, vertices, nearest, balls)
            shape = points.shape
            normal = np.broadcast_to(np.array([0.0, 0.3, 0.954]), shape)
            radii = LASH_RADIUS_M * np.interp(along, [0, 1], [1.2, 0.3]) * np.ones((count, 1))
            parts.append((roots, points, radii, np.broadcast_to(colour * 0.25, shape), normal, np.full(shape[:2], 0.8)))
    return Strands(*(np.concatenate([part[k] for part in parts]) for k in range(6)))


def face_at(
    head: HeadModel, vertices: Float[np.ndarray, "v 3"], at: Int[np.ndarray, " n"], balls: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " n"]:
    """Give for each vertex that triangle of the lids around it that looks most to the front: the lid's outside."""
    rows = np.flatnonzero(~np.isin(head.faces, balls).any(axis=1))
    corners = vertices[head.faces[rows]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    frontal = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    rows = rows[np.argsort(frontal)]  # the most frontal one is written last
    best = np.full(head.n_vertices, -1)
    for k in range(3):
        later = np.full(head.n_vertices, -1)
        later[head.faces[rows, k]] = np.arange(len(rows))
        best = np.maximum(best, later)
    found: np.ndarray = rows[best[at]]
    return found
