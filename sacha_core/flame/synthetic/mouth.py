"""Lips around a slit, the pocket of the mouth behind them, and two rows of teeth in it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.synthetic.layout import Part
from sacha_core.flame.synthetic.loft import locate, loft
from sacha_core.flame.synthetic.relief import relief
from sacha_core.flame.synthetic.sizes import Size

__all__ = ["MOUTH_CORNER", "MOUTH_LINE", "lip_rings", "slit_height", "tooth_row"]

MOUTH_LINE = -0.0515  # height of the slit
MOUTH_CORNER = (0.0245, MOUTH_LINE, 0.0405)  # on the subject's left, where the lips meet
LIP_HALF_WIDTH = 0.0262
LIP_HEIGHT = (0.0086, 0.0098)  # of the upper and the lower lip
SLIT_HALF_WIDTH = 0.0240
SLIT_HALF_HEIGHT = 0.0005  # the lips stand a little apart
CORNER_RISE = 0.0008
MIDDLE_DROP = 0.0006
BOW = 0.0018  # depth of the bow in the outline of the upper lip

# Rings of the lips: place from the border of the block (-1) by the outline (0) to the slit (1), and how far they stand out.
_LIPS = {
    "around": (-0.45, 0.0),
    "outline": (0.0, 0.0008),
    "lip_out": (0.28, 0.0028),
    "lip": (0.60, 0.0042),
    "lip_in": (0.86, 0.0036),
    "slit": (1.0, 0.0014),
}
# Rings of the pocket: half width, height above and below the slit, depth behind the slit at the same place, and how much of that place's
# own depth is kept (the rest is the depth of the middle, so that deep rings are flat).
_POCKET = {
    "wet": (0.0228, 0.0012, 0.0012, 0.0050, 1.0),
    "vestibule": (0.0256, 0.0125, 0.0110, 0.0125, 0.9),
    "wall": (0.0262, 0.0150, 0.0125, 0.0420, 0.35),
    "throat": (0.0150, 0.0100, 0.0110, 0.0620, 0.0),
}
THROAT = (0.0, MOUTH_LINE, -0.0150)

# Rows of teeth: half width and depth of the arch, foremost point, height of the roots and of the edges.
_UPPER = (0.0226, 0.0260, 0.0462, MOUTH_LINE + 0.0120, MOUTH_LINE - 0.0012)
_LOWER = (0.0208, 0.0245, 0.0432, MOUTH_LINE - 0.0120, MOUTH_LINE - 0.0016)
ARCH_END_RAD = 1.30  # from the middle of the arch to its last tooth
# Points of a tooth's section: part of the way from root to edge, distance behind the front, rounding off towards its neighbours.
_TOOTH = {
    "root": (0.0, 0.0010, 0.4),
    "front": (0.55, 0.0, 1.0),
    "edge": (1.0, 0.0010, 1.0),
    "edge_behind": (0.98, 0.0024, 1.0),
    "root_behind": (0.0, 0.0050, 0.4),
}
GAP_DEPTH = 0.0007  # how far the front recedes between two teeth
GAP_HEIGHT = 0.0007  # how much shorter a tooth is there


def lip_rings(
    size: Size, border: Float[np.ndarray, "m 3"], border_uv: Float[np.ndarray, "m 2"], turn_rad: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "k m 3"], Float[np.ndarray, " 3"]]:
    """Place the rings of the mouth's patch and the point that closes it.

    Args:
        size: resolution; says which rings.
        border: (m, 3) the border of the block on the finished face.
        border_uv: (m, 2) its angle and height on the loft, from which the search for points of the face starts.
        turn_rad: (m,) angle about the mouth, 0 at the left corner, pi/2 up.

    Returns:
        (k, m, 3) rings and (3,) closing point, metres.

    Source: own.
    """
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    slit = _lip_ring("slit", border, border_uv, cos, sin)
    rings = []
    for name in size.mouth_rings:
        if name in _LIPS:
            rings.append(_lip_ring(name, border, border_uv, cos, sin))
            continue
        half_width, above, below, depth, kept = _POCKET[name]
        y = MOUTH_LINE + np.where(sin > 0, above, below) * np.sign(sin) * np.abs(sin) ** 0.7
        z = kept * slit[:, 2] + (1 - kept) * slit[:, 2].max() - depth
        rings.append(np.column_stack([half_width * cos, y, z]))
    return np.array(rings), np.asarray(THROAT)


def slit_height(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Height y of the line between the lips: a little lower in the middle, a little higher at the corners."""
    across = np.minimum(np.abs(x) / SLIT_HALF_WIDTH, 1.0)
    middle = np.exp(-0.5 * (across / 0.2) ** 2)
    height: Float[np.ndarray, " n"] = MOUTH_LINE + CORNER_RISE * across * across - MIDDLE_DROP * middle
    return height


def _lip_ring(
    name: str,
    border: Float[np.ndarray, "m 3"],
    border_uv: Float[np.ndarray, "m 2"],
    cos: Float[np.ndarray, " m"],
    sin: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "m 3"]:
    place, out = _LIPS[name]
    upper = sin > 0
    outline_y = np.where(upper, LIP_HEIGHT[0], -LIP_HEIGHT[1]) * np.abs(sin) ** np.where(upper, 1.5, 1.35)
    outline_y -= np.where(upper, BOW, 0.0) * np.exp(-0.5 * (cos / 0.11) ** 2)
    rise = CORNER_RISE * cos * cos
    outline = np.column_stack([LIP_HALF_WIDTH * cos, MOUTH_LINE + outline_y + rise])
    slit_x = SLIT_HALF_WIDTH * cos
    slit = np.column_stack([slit_x, slit_height(slit_x) + SLIT_HALF_HEIGHT * np.sign(sin) * np.abs(sin) ** 1.3])
    flat = outline + (slit - outline) * place if place >= 0 else outline + (border[:, :2] - outline) * -place
    guess = border_uv + (border_uv.mean(axis=0) - border_uv) * (1 + place) / 2.5
    face = loft(*locate(flat[:, 0], flat[:, 1], guess[:, 0], guess[:, 1]))
    face += relief(face)
    # The relief pushes sideways too: the nearer to the border, the more the ring goes along.
    flat = flat + max(-place, 0.0) * (face[:, :2] - flat)
    z = face[:, 2] + out * np.abs(sin) ** 0.8 * np.where(upper, 1.0, 1.1)
    return np.column_stack([flat, z - max(place, 0.0) * 0.0015 * np.abs(cos) ** 6])


def tooth_row(size: Size, upper: bool) -> Part:
    """Build one row of teeth: a closed tube along the arch, notched between the teeth; unrolled into the unit square.

    Args:
        size: resolution.
        upper: the upper row, else the lower.

    Returns:
        The part; its vertices run along the arch from the right end to the left, one line after another around the section.

    Source: own.
    """
    half_width, depth, foremost, root_y, edge_y = _UPPER if upper else _LOWER
    n = size.teeth * size.columns_per_tooth
    along = np.linspace(-1.0, 1.0, n + 1)
    angle = along * ARCH_END_RAD
    notch = (
        np.abs(np.cos(np.pi * np.arange(n + 1) / size.columns_per_tooth)) ** 4
        if size.columns_per_tooth > 1
        else np.zeros(n + 1)
    )
    outward = np.column_stack([np.sin(angle) / half_width, np.cos(angle) / depth])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    arch = np.column_stack([half_width * np.sin(angle), foremost - depth * (1 - np.cos(angle))])
    lines = []
    for name in size.tooth_section:
        part, behind, depth_of_notch = _TOOTH[name]
        flat = arch - outward * (behind + depth_of_notch * GAP_DEPTH * notch)[:, None]
        y = root_y + (edge_y - root_y) * part - np.sign(edge_y - root_y) * depth_of_notch * part * GAP_HEIGHT * notch
        lines.append(np.column_stack([flat[:, 0], y, flat[:, 1]]))
    faces, uv_faces, uv = _tube(len(lines), n)
    if not upper:
        faces, uv_faces = faces[:, ::-1].copy(), uv_faces[:, ::-1].copy()
    return Part(np.concatenate(lines), faces, uv, uv_faces)


def _tube(section: int, n: int) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "u 2"]]:
    """Connect `section` lines of n + 1 points to a tube with two ends, and unroll it: one more line, and an end on either side."""
    faces: list[tuple[int, int, int]] = []
    uv_faces: list[tuple[int, int, int]] = []
    for i in range(n):
        for j in range(section):
            for triangles, around in ((faces, section), (uv_faces, section + 1)):
                a, b = j * (n + 1) + i, (j + 1) % around * (n + 1) + i
                rising = [(a, b, b + 1), (a, b + 1, a + 1)]
                triangles.extend(rising if 2 * i >= n else [(a, b, a + 1), (b, b + 1, a + 1)])
    margin, ends = 0.06, (section + 1) * (n + 1)
    uv = [(margin + (1 - 2 * margin) * i / n, j / section) for j in range(section + 1) for i in range(n + 1)]
    angle = 2 * np.pi * np.arange(section) / section
    for centre in (margin / 2, 1 - margin / 2):
        uv += [(centre + 0.4 * margin * float(np.cos(t)), 0.5 - 0.4 * float(np.sin(t))) for t in angle]
    for j in range(1, section - 1):
        faces += [(0, (j + 1) * (n + 1), j * (n + 1)), (n, j * (n + 1) + n, (j + 1) * (n + 1) + n)]
        uv_faces += [(ends, ends + j + 1, ends + j), (ends + section, ends + section + j, ends + section + j + 1)]
    return np.array(faces, np.int32), np.array(uv_faces, np.int32), np.array(uv)
