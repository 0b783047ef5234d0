"""Eyeballs, and the lids around them: skin that comes in from the orbit, folds, lies on the eyeball and turns in behind its margin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.layout import Part
from sacha_core.flame.synthetic.loft import locate, loft
from sacha_core.flame.synthetic.relief import relief
from sacha_core.flame.synthetic.sizes import Size

__all__ = ["EYE_CENTRE", "EYE_RADIUS", "LID_CLEARANCE", "eyeball", "lid_rings"]

EYE_CENTRE = (0.0325, 0.0190, 0.0248)  # of the left one
EYE_RADIUS = 0.0142
LID_CLEARANCE = 0.0004  # between the eyeball and the inside of a lid
LID_THICKNESS = 0.0014
HALF_WIDTH = 0.0136  # of the opening between the lids
OPENING = (0.0063, 0.0050)  # above and below the line of the corners
FOLD_HALF_WIDTH = 0.0172
FOLD = (0.0112, 0.0104)  # where the crease of the upper lid, and the faint one of the lower, run
SLANT = 0.06  # how much higher the outer corner lies, per unit of width

SUNKEN = 0.0015  # how far lids may lie behind the face around them

# Rings from the orbit to the margin: place between the border (0), the crease (1) and the margin (2); share of the eyeball in the
# shape, the rest being the face; depth of the fold above and below.
_OUTSIDE = {
    "orbit": (0.55, 0.0, 0.0, 0.0),
    "fold": (0.84, 0.30, -0.0015, -0.0002),
    "crease": (1.10, 0.62, 0.0020, 0.0005),
    "lid": (1.55, 1.0, 0.0, 0.0),
    "margin": (2.0, 1.0, 0.0, 0.0),
}
# Rings behind the margin: how far on from the margin towards the equator of the eyeball, and clearance.
_INSIDE = {"margin_in": (0.0, 0.0), "socket": (0.30, 0.0)}
SOCKET_DEPTH = 0.0030  # clearance of the point that closes the socket behind the eyeball


def lid_rings(
    size: Size, border: Float[np.ndarray, "m 3"], border_uv: Float[np.ndarray, "m 2"], turn_rad: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "k m 3"], Float[np.ndarray, " 3"]]:
    """Place the rings of the left eye's patch and the point that closes it.

    Args:
        size: resolution; says which rings.
        border: (m, 3) the border of the block on the finished face.
        border_uv: (m, 2) its angle and height on the loft, from which the search for points of the face starts.
        turn_rad: (m,) angle about the eye, 0 at the outer corner, pi/2 up.

    Returns:
        (k, m, 3) rings and (3,) closing point, metres.

    Source: own.
    """
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    crease = _almond(cos, sin, FOLD_HALF_WIDTH, FOLD, 0.9)
    margin = _almond(cos, sin, HALF_WIDTH, OPENING, 1.25)
    rings = []
    for name in size.eye_rings:
        if name in _OUTSIDE:
            place, of_eyeball, above, below = _OUTSIDE[name]
            flat = _between(border[:, :2], crease, margin, place)
            guess = border_uv + (border_uv.mean(axis=0) - border_uv) * (place / 3)
            at = locate(flat[:, 0], flat[:, 1], guess[:, 0], guess[:, 1])
            face = loft(*at)
            face += relief(face)
            # The relief pushes sideways too: far from the eyeball the ring goes with the face, at the margin it is where it was drawn.
            flat = flat + (1 - of_eyeball) * (face[:, :2] - flat)
            face_z = face[:, 2]
            lid_z = _on_eyeball(flat, LID_CLEARANCE + LID_THICKNESS)
            if of_eyeball < 1:  # past the edge of the eyeball the face goes on as it was
                lid_z = np.maximum(lid_z, face_z - SUNKEN)
            z = face_z + of_eyeball * (lid_z - face_z)
            z -= np.where(sin > 0, above, below) * np.abs(sin)
            over_eyeball = np.hypot(*(flat - EYE_CENTRE[:2]).T) < EYE_RADIUS
            z = np.where(over_eyeball, np.maximum(z, _on_eyeball(flat, LID_CLEARANCE + LID_THICKNESS)), z)
            rings.append(np.column_stack([flat, z]))
        else:
            rings.append(_behind_margin(margin, *_INSIDE[name]))
    behind = np.asarray(EYE_CENTRE) - [0.0, 0.0, EYE_RADIUS + SOCKET_DEPTH]
    return np.array(rings), behind


def eyeball(size: Size) -> Part:
    """Build the left eyeball: a sphere about `EYE_CENTRE`, finest at the iris; unwrapped to the unit disc by polar angle.

    Args:
        size: resolution.

    Returns:
        The part; its vertices are the front pole, rings of `eyeball_segments` from front to back, the back pole.

    Source: own.
    """
    m, polar = size.eyeball_segments, np.radians(size.eyeball_polar_deg)
    n_rings = len(polar)
    around = 2 * np.pi * np.arange(m) / m
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    discs = np.concatenate([[[0.0, 0.0]], *(np.sin(p) * circle for p in polar), [[0.0, 0.0]]])
    depth = np.concatenate([[1.0], np.repeat(np.cos(polar), m), [-1.0]])
    faces: list[tuple[int, int, int]] = []
    uv_faces: list[tuple[int, int, int]] = []
    for j in range(m):
        i = (j + 1) % m
        faces.append((0, 1 + j, 1 + i))
        for k in range(1, n_rings):
            a, b = 1 + (k - 1) * m, 1 + k * m
            faces += [(a + j, b + j, b + i), (a + j, b + i, a + i)]
        uv_faces += faces[len(uv_faces) :]
        last = 1 + (n_rings - 1) * m
        faces.append((last + j, last + m, last + i))
        uv_faces.append((last + j, last + m + j, last + i))  # in the picture the back pole is a circle of its own
    between = 2 * np.pi * (np.arange(m) + 0.5) / m
    rim = np.stack([np.cos(between), np.sin(between)], axis=1)
    return Part(
        vertices=np.asarray(EYE_CENTRE) + EYE_RADIUS * np.column_stack([discs, depth]),
        faces=np.array(faces, np.int32),
        uv=np.concatenate([[[0.0, 0.0]], *(p / np.pi * circle for p in polar), rim]),
        uv_faces=np.array(uv_faces, np.int32),
    )


def _almond(
    cos: Float[np.ndarray, " m"],
    sin: Float[np.ndarray, " m"],
    half_width: float,
    heights: tuple[float, float],
    keenness: float,
) -> Float[np.ndarray, "m 2"]:
    x = half_width * cos
    y = np.where(sin > 0, heights[0], heights[1]) * np.sign(sin) * np.abs(sin) ** keenness + SLANT * x
    return np.column_stack([EYE_CENTRE[0] + x, EYE_CENTRE[1] + y])


def _between(
    border: Float[np.ndarray, "m 2"], crease: Float[np.ndarray, "m 2"], margin: Float[np.ndarray, "m 2"], place: float
) -> Float[np.ndarray, "m 2"]:
    outer, inner, part = (border, crease, place) if place <= 1 else (crease, margin, place - 1)
    between: Float[np.ndarray, "m 2"] = outer + (inner - outer) * part
    return between


def _on_eyeball(flat: Float[np.ndarray, "m 2"], clearance: float) -> Float[np.ndarray, " m"]:
    away = flat - EYE_CENTRE[:2]
    depth: Float[np.ndarray, " m"] = np.sqrt(np.maximum((EYE_RADIUS + clearance) ** 2 - (away * away).sum(axis=1), 0.0))
    return EYE_CENTRE[2] + depth


def _behind_margin(margin: Float[np.ndarray, "m 2"], onward: float, more_clearance: float) -> Float[np.ndarray, "m 3"]:
    edge = np.column_stack([margin, _on_eyeball(margin, LID_CLEARANCE + LID_THICKNESS)]) - EYE_CENTRE
    across = np.hypot(edge[:, 0], edge[:, 1])
    polar = np.arctan2(across, edge[:, 2])
    polar = polar + onward * (np.pi / 2 - polar)
    radius = EYE_RADIUS + LID_CLEARANCE + more_clearance
    flat = edge[:, :2] / across[:, None] * np.sin(polar)[:, None]
    return np.asarray(EYE_CENTRE) + radius * np.column_stack([flat, np.cos(polar)])
