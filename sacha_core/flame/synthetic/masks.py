"""Which vertices belong to which region, under FLAME's fourteen names; regions overlap and a few folded-in vertices have none, as there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from sacha_core.flame.synthetic.anatomy import Anatomy
from sacha_core.flame.synthetic.eyes import EYE_CENTRE

__all__ = ["region_masks"]

HAIRLINE, CHIN, BOUNDARY_TOP = 2.45, 11.4, 14.9  # loft heights
# How far round the face reaches at some loft heights: to just before the ears, and under them to the angle of the jaw.
FACE_SIDE = ((5.0, 7.0, 8.0), (1.32, 1.40, 1.72))
# Loft height at which the neck begins, at some angles: at the edge of the jaw, and behind under the hair.
NECK_TOP = ((1.6, 2.1), (11.0, 9.2))
FOREHEAD_BOTTOM_Y = 0.0540
NOSE_Y = (-0.0335, 0.0270)
NOSE_HALF_WIDTH = (0.0205, 0.0095)  # at its bottom and at its top
EYE_REGION_RADIUS = (0.0270, 0.0290)  # lids, brow and bag of an eye
_LID_RINGS = ("fold", "crease", "lid", "margin")
_LIP_RINGS = ("outline", "lip_out", "lip", "lip_in", "slit")


def region_masks(anatomy: Anatomy) -> dict[str, Int[np.ndarray, " m"]]:
    """Sort the vertices into FLAME's regions.

    Args:
        anatomy: the mean head.

    Returns:
        Vertex indices by name, ascending.

    Source: own; the names are those of the official FLAME masks.
    """
    v, angle, height = anatomy.vertices, np.abs(anatomy.angle_rad), anatomy.height
    x, y = np.abs(v[:, 0]), v[:, 1]
    hidden = np.ones(len(v), bool)
    hidden[anatomy.parts["skin"]] = False
    ears = {side: _patch(anatomy, f"{side}_ear") for side in ("left", "right")}
    for side in ("left", "right"):
        hidden[_inside_lids(anatomy, side)] = True
        hidden[ears[side]] = True
    mouth = _patch(anatomy, "mouth")
    lips = _rings(anatomy, "mouth", _LIP_RINGS)
    hidden[np.setdiff1d(mouth, np.concatenate([lips, _rings(anatomy, "mouth", ("around",))]))] = True
    face = ~hidden & (angle <= np.interp(height, *FACE_SIDE)) & (height >= HAIRLINE) & (height <= CHIN)
    neck_top = np.interp(angle, *NECK_TOP)
    neck = ~hidden & ~face & (height >= neck_top)
    breadth = np.interp(y, NOSE_Y, NOSE_HALF_WIDTH)
    nose = face & (x <= breadth) & (y >= NOSE_Y[0]) & (y <= NOSE_Y[1])
    masks = {
        "face": face,
        "neck": neck,
        "scalp": ~hidden & ~face & (height <= neck_top),
        "boundary": ~hidden & (height >= BOUNDARY_TOP),
        "forehead": face & (y >= FOREHEAD_BOTTOM_Y),
        "nose": nose,
        "lips": _as_mask(anatomy, lips),
    }
    masks["eye_region"] = np.zeros(len(v), bool)
    for side, sign in (("left", 1), ("right", -1)):
        around = (v[:, :2] - np.asarray(EYE_CENTRE[:2]) * [sign, 1]) / EYE_REGION_RADIUS
        masks["eye_region"] |= face & ~nose & ((around * around).sum(axis=1) <= 1)
        masks[f"{side}_eye_region"] = _as_mask(anatomy, _rings(anatomy, f"{side}_eye", _LID_RINGS))
        masks[f"{side}_eyeball"] = _as_mask(anatomy, anatomy.parts[f"{side}_eyeball"])
        masks[f"{side}_ear"] = _as_mask(anatomy, ears[side])
    return {name: np.flatnonzero(mask).astype(np.int32) for name, mask in masks.items()}


def _as_mask(anatomy: Anatomy, ids: Int[np.ndarray, " m"]) -> np.ndarray:
    mask = np.zeros(len(anatomy.vertices), bool)
    mask[ids] = True
    return mask


def _patch(anatomy: Anatomy, name: str) -> Int[np.ndarray, " m"]:
    return np.concatenate([ids for part, ids in anatomy.parts.items() if part.startswith(f"{name}/")])


def _rings(anatomy: Anatomy, patch: str, names: tuple[str, ...]) -> Int[np.ndarray, " m"]:
    found = [anatomy.parts[f"{patch}/{name}"] for name in names if f"{patch}/{name}" in anatomy.parts]
    return np.concatenate(found) if found else np.zeros(0, np.int32)


def _inside_lids(anatomy: Anatomy, side: str) -> Int[np.ndarray, " m"]:
    return np.setdiff1d(_patch(anatomy, f"{side}_eye"), _rings(anatomy, f"{side}_eye", ("orbit", *_LID_RINGS)))
