"""Joints and skinning weights: eyeballs on the eyes, lower teeth, lip and chin on the jaw, the neck fading to the root."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.synthetic.anatomy import Anatomy
from sacha_core.flame.synthetic.mouth import MOUTH_CORNER, slit_height
from sacha_core.flame.synthetic.spline import smooth_step

__all__ = ["PARENTS", "below_mouth", "joint_regressor", "skinning_weights"]

ROOT, NECK, JAW, LEFT_EYE, RIGHT_EYE = range(5)
PARENTS = np.array([-1, 0, 1, 1, 1], np.int32)
HINGE = np.array([0.0, -0.0100, -0.0480])  # of the jaw, between the ears
CHIN_EDGE = np.array([0.0, -0.1080, 0.0300])  # where the lower face ends, under the chin
JAW_ANGLE = np.array([0.0, -0.0760, -0.0450])  # and where it ends below the ear
SLIT_SOFTNESS = 0.0003  # half the height over which the mouth divides between the lips
NECK_HEIGHT = (-0.1750, -0.1150)  # below the first everything follows the root, above the second the neck
HINGE_SPOT = np.array([0.0690, -0.0100, -0.0480])
ROOT_HEIGHT, NECK_JOINT_HEIGHT = 14.5, 12.9  # loft heights of the rings whose middles are the root and the neck joint


def below_mouth(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Tell what lies below the mouth (1) from what lies above (0): sharply between the lips, softly in the cheeks.

    Args:
        points: (n, 3) metres, on the mean head.

    Returns:
        (n,) between 0 and 1.

    Source: own.
    """
    across = np.abs(points[:, 0])
    # From the corner of the mouth the border rises to the hinge of the jaw.
    back = np.clip((MOUTH_CORNER[2] - points[:, 2]) / (MOUTH_CORNER[2] - HINGE[2]), 0.0, 1.0)
    outside = smooth_step(across, 0.6 * MOUTH_CORNER[0], 1.9 * MOUTH_CORNER[0])
    slit = slit_height(across)
    line = slit + outside * back * (HINGE[1] - slit)
    softness = SLIT_SOFTNESS + outside * (0.012 + 0.020 * back)
    return smooth_step(line - points[:, 1], -softness, softness)


def skinning_weights(anatomy: Anatomy) -> Float[np.ndarray, "v j"]:
    """Give every vertex its joints.

    Args:
        anatomy: the mean head.

    Returns:
        (v, 5) weights; rows sum to 1.

    Source: own.
    """
    v = anatomy.vertices
    weights = np.zeros((len(v), len(PARENTS)))
    neck = smooth_step(v[:, 1] - 0.15 * (v[:, 2] + 0.05), *NECK_HEIGHT)
    edge = (
        JAW_ANGLE
        + (CHIN_EDGE - JAW_ANGLE) * np.clip((v[:, 2] - JAW_ANGLE[2]) / (CHIN_EDGE[2] - JAW_ANGLE[2]), 0.0, 1.3)[:, None]
    )
    above_edge = smooth_step(v[:, 1] - edge[:, 1], -0.042, 0.012)
    before_hinge = smooth_step(v[:, 2], HINGE[2] - 0.020, HINGE[2] + 0.050)
    jaw = below_mouth(v) * above_edge * before_hinge
    weights[:, JAW] = jaw
    weights[:, NECK] = (1 - jaw) * neck
    weights[:, ROOT] = (1 - jaw) * (1 - neck)
    for part, joint in (
        ("left_eyeball", LEFT_EYE),
        ("right_eyeball", RIGHT_EYE),
        ("upper_teeth", NECK),
        ("lower_teeth", JAW),
    ):
        weights[anatomy.parts[part]] = 0.0
        weights[anatomy.parts[part], joint] = 1.0
    return weights


def joint_regressor(anatomy: Anatomy) -> Float[np.ndarray, "j v"]:
    """Say where the joints are: middles of rings around them, so that they follow the shape of the person.

    Args:
        anatomy: the mean head.

    Returns:
        (5, v) weights; rows sum to 1.

    Source: own.
    """
    regressor = np.zeros((len(PARENTS), len(anatomy.vertices)))
    skin = anatomy.skin
    for joint, height in ((ROOT, ROOT_HEIGHT), (NECK, NECK_JOINT_HEIGHT)):
        ring = skin.grid[np.argmin(np.abs(skin.height - height))]
        # Columns crowd in front: opposite points in pairs keep the middle of the ring in the middle of the neck.
        front, back = ring[len(ring) // 2], ring[0]
        side = np.argmin(np.abs(skin.angle_rad - np.pi / 2))
        pair = ring[side], ring[(len(ring) - side) % len(ring)]
        regressor[joint, [front, back, *pair]] = 0.25
    for sign in (1, -1):
        spot = np.linalg.norm(anatomy.vertices[: skin.n_vertices] - HINGE_SPOT * [sign, 1, 1], axis=1)
        spot[_patch_vertices(anatomy)] = np.inf
        regressor[JAW, np.argmin(spot)] = 0.5
    equator = 1 + anatomy.size.eyeball_polar_deg.index(90.0) * anatomy.size.eyeball_segments
    for joint, part in ((LEFT_EYE, "left_eyeball"), (RIGHT_EYE, "right_eyeball")):
        ring = anatomy.parts[part][equator : equator + anatomy.size.eyeball_segments]
        regressor[joint, ring] = 1 / len(ring)
    return regressor


def _patch_vertices(anatomy: Anatomy) -> Int[np.ndarray, " m"]:
    return np.concatenate([ids for name, ids in anatomy.parts.items() if "/" in name])
