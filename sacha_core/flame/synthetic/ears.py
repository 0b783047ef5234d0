"""Ears: a patch that leaves the side of the head, turns over at the rim and comes back in by its folds to the bowl."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.loft import loft
from sacha_core.flame.synthetic.relief import relief
from sacha_core.flame.synthetic.sizes import Size
from sacha_core.flame.synthetic.spline import smooth_step

__all__ = ["EAR_CENTRE", "ear_rings"]

EAR_CENTRE = (0.0730, 0.0060, -0.0560)  # where the left ear's outline is centred, on the side of the head
HALF_LENGTH = 0.0325
HALF_BREADTH = 0.0175
SET_BACK = 0.0120  # of the middle of the outline behind its attachment
LEAN_RAD = 0.20  # of the long axis, backwards
FLARE = 0.50  # how far it stands off per distance behind its front

# Rings from the rim inwards: size of the outline, height over the plane of the ear.
_FOLDS = {
    "rim_behind": (0.97, -0.0026),
    "rim": (1.0, 0.0004),
    "rim_front": (0.89, 0.0026),
    "scapha": (0.79, -0.0022),
    "antihelix": (0.64, 0.0024),
    "concha_edge": (0.53, -0.0004),
    "concha": (0.38, -0.0076),
}
BOWL_DEPTH = -0.0088
BOWL_SHIFT = (-0.0035, -0.0040)  # of the middle folds: forwards and down
TRAGUS = 0.0042  # how far the flap before the bowl stands up
ROOT = (0.66, 0.74)  # size of the attachment, of the block's width and height


def ear_rings(
    size: Size, border_uv: Float[np.ndarray, "m 2"], turn_rad: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "k m 3"], Float[np.ndarray, " 3"]]:
    """Place the rings of the left ear's patch and the point that closes it.

    Args:
        size: resolution; says which rings.
        border_uv: (m, 2) angle and height on the loft of the block's border.
        turn_rad: (m,) angle about the ear, 0 behind, pi/2 up.

    Returns:
        (k, m, 3) rings and (3,) closing point, metres.

    Source: own.
    """
    centre_uv = (border_uv.min(axis=0) + border_uv.max(axis=0)) / 2
    half_uv = (border_uv.max(axis=0) - border_uv.min(axis=0)) / 2
    # Heights of the loft are counted downwards.
    foot_uv = centre_uv + half_uv * ROOT * np.stack([np.cos(turn_rad), -np.sin(turn_rad)], axis=1)
    foot = loft(foot_uv[:, 0], foot_uv[:, 1])
    root = foot + relief(foot)
    rings = []
    for name in size.ear_rings:
        if name == "root":
            rings.append(root)
        elif name == "behind":
            rings.append(0.5 * (root + _fold(turn_rad, *_FOLDS["rim_behind"])))
        else:
            rings.append(_fold(turn_rad, *_FOLDS[name]))
    middle = _fold(turn_rad, 0.1, BOWL_DEPTH).mean(axis=0)
    return np.array(rings), middle


def _fold(turn_rad: Float[np.ndarray, " m"], scale: float, over: float) -> Float[np.ndarray, "m 3"]:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    # The outline is broad above and narrows to the lobe.
    back = scale * HALF_BREADTH * cos * (1 + 0.26 * sin)
    up = scale * HALF_LENGTH * sin
    inner = 1 - smooth_step(np.full_like(cos, scale), 0.5, 1.0)
    back, up = back + inner * BOWL_SHIFT[0], up + inner * BOWL_SHIFT[1]
    # Folds run out towards the front, where the ear grows from the cheek.
    out = FLARE * (back + SET_BACK + 0.004) + over * (0.45 + 0.55 * (1 + cos) / 2)
    out += TRAGUS * np.exp(-0.5 * (((1 + cos) / 0.18) ** 2 + ((scale - 0.58) / 0.10) ** 2))
    back = back + SET_BACK
    leant_back = back * np.cos(LEAN_RAD) + up * np.sin(LEAN_RAD)
    leant_up = up * np.cos(LEAN_RAD) - back * np.sin(LEAN_RAD)
    fold: Float[np.ndarray, "m 3"] = np.asarray(EAR_CENTRE) + np.column_stack([out, leant_up, -leant_back])
    return fold
