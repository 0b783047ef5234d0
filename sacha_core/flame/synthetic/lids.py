"""How lids move: each point turns on the eyeball about the axis from ear to ear, the more the nearer it is to the margin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.synthetic.anatomy import MIRROR, Anatomy
from sacha_core.flame.synthetic.eyes import EYE_CENTRE

__all__ = ["close_lids", "turn_lids"]

# How far each ring goes along with the margin.
_FOLLOW = {"fold": 0.03, "crease": 0.16, "lid": 0.60, "margin": 1.0, "margin_in": 1.0, "socket": 0.45}
MEETING_PLACE = 0.22  # where closed lids meet, from the lower margin (0) to the upper (1)
LEFT_OPEN = 0.02  # of the opening, either lid stops short of the other


def close_lids(anatomy: Anatomy, side: str, upper: float, lower: float) -> Float[np.ndarray, "v 3"]:
    """Displace the lids of one eye towards each other.

    Args:
        anatomy: the mean head.
        side: left or right.
        upper: how far the upper lid goes: 1 to where the lids meet, negative opens wider.
        lower: the same for the lower lid.

    Returns:
        (v, 3) metres.

    Source: own.
    """
    patch = anatomy.skin.patches[f"{side}_eye"]
    margin = _elevation(anatomy, side, f"{side}_eye/margin")
    opposite = _opposite(patch.turn_rad)
    above = np.sin(patch.turn_rad) > 0
    low, high = np.where(above, margin[opposite], margin), np.where(above, margin, margin[opposite])
    gap = high - low
    meeting = low + (MEETING_PLACE + np.where(above, LEFT_OPEN, -LEFT_OPEN)) * gap
    turn = (meeting - margin) * np.where(above, upper, lower)
    turn[np.abs(np.sin(patch.turn_rad)) < 1e-9] = 0.0
    return turn_lids(anatomy, side, turn)


def turn_lids(anatomy: Anatomy, side: str, up_rad: Float[np.ndarray, " m"]) -> Float[np.ndarray, "v 3"]:
    """Displace the lids of one eye by turning them on the eyeball.

    Args:
        anatomy: the mean head.
        side: left or right.
        up_rad: (m,) how far each point of the margin turns upwards.

    Returns:
        (v, 3) metres.

    Source: own.
    """
    moved = np.zeros_like(anatomy.vertices)
    centre = _centre(side)
    for ring, follow in _FOLLOW.items():
        name = f"{side}_eye/{ring}"
        if name not in anatomy.parts:
            continue
        ids = anatomy.parts[name]
        x, y, z = (anatomy.vertices[ids] - centre).T
        cos, sin = np.cos(follow * up_rad), np.sin(follow * up_rad)
        moved[ids] = np.column_stack([x, cos * y + sin * z, cos * z - sin * y]) + centre - anatomy.vertices[ids]
    return moved


def _elevation(anatomy: Anatomy, side: str, name: str) -> Float[np.ndarray, " m"]:
    away = anatomy.vertices[anatomy.parts[name]] - _centre(side)
    elevation: Float[np.ndarray, " m"] = np.arctan2(away[:, 1], away[:, 2])
    return elevation


def _centre(side: str) -> Float[np.ndarray, " 3"]:
    centre: Float[np.ndarray, " 3"] = np.asarray(EYE_CENTRE) * (MIRROR if side == "right" else np.ones(3))
    return centre


def _opposite(turn_rad: Float[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
    """For each point of a ring the one on the other lid at the same place between the corners."""
    here, mirrored = np.exp(1j * turn_rad), np.exp(-1j * turn_rad)
    opposite: Int[np.ndarray, " m"] = np.argmin(np.abs(here[:, None] - mirrored[None, :]), axis=1)
    return opposite
