"""The head without features: closed sections strung along its height, from the crown over skull, jaw and neck to the shoulders.

A section is given by its points in front, at the side and behind; between the sections run smooth curves, so that the drawing of the
profile below is the profile of the head. Metres, in FLAME's frame: x to the subject's left, y up, z forward.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.spline import smooth_curve

__all__ = ["N_KNOTS", "locate", "loft"]

# One row a section: y and z in front; x, y and z at the side; y and z behind; fullness of the front and of the back half (2 is an
# ellipse, more is boxier, less is keener).
SECTIONS = np.array(
    [
        # front y, z      side x, y, z              back y, z       fullness
        [0.1340, -0.0500, 0.0000, 0.1340, -0.0500, 0.1340, -0.0500, 2.0, 2.0],  # crown
        [0.1275, -0.0080, 0.0375, 0.1230, -0.0500, 0.1215, -0.0940, 2.0, 2.0],
        [0.1070, 0.0290, 0.0600, 0.0990, -0.0520, 0.0950, -0.1280, 2.1, 2.1],  # hairline
        [0.0790, 0.0480, 0.0710, 0.0690, -0.0550, 0.0600, -0.1450, 2.2, 2.1],  # forehead
        [0.0480, 0.0545, 0.0740, 0.0420, -0.0580, 0.0280, -0.1480, 2.25, 2.1],  # brow
        [0.0220, 0.0500, 0.0725, 0.0180, -0.0580, 0.0000, -0.1410, 2.15, 2.1],  # eyes
        [-0.0050, 0.0490, 0.0705, -0.0080, -0.0560, -0.0250, -0.1280, 2.0, 2.1],  # nose
        [-0.0290, 0.0500, 0.0672, -0.0300, -0.0520, -0.0450, -0.1160, 1.85, 2.1],  # under the nose
        [-0.0510, 0.0510, 0.0625, -0.0510, -0.0480, -0.0620, -0.1090, 1.75, 2.1],  # mouth
        [-0.0710, 0.0465, 0.0565, -0.0680, -0.0450, -0.0770, -0.1060, 1.65, 2.1],  # hollow over the chin
        [-0.0900, 0.0460, 0.0505, -0.0820, -0.0430, -0.0900, -0.1050, 1.55, 2.1],  # chin
        [-0.1050, 0.0350, 0.0470, -0.0950, -0.0430, -0.1020, -0.1045, 1.6, 2.1],  # under the chin
        [-0.1120, 0.0110, 0.0470, -0.1090, -0.0440, -0.1150, -0.1045, 1.75, 2.1],
        [-0.1210, -0.0080, 0.0485, -0.1250, -0.0470, -0.1300, -0.1055, 1.95, 2.1],  # throat
        [-0.1420, -0.0110, 0.0510, -0.1450, -0.0510, -0.1480, -0.1085, 2.0, 2.1],
        [-0.1650, -0.0070, 0.0600, -0.1660, -0.0540, -0.1660, -0.1150, 2.0, 2.1],
        [-0.1870, 0.0040, 0.0860, -0.1850, -0.0560, -0.1820, -0.1250, 2.1, 2.2],  # shoulders
    ]
)
N_KNOTS = len(SECTIONS)
# The curves run on over the crown, where front and back change places and left turns to right, so that it is round and not a cone.
_OVER = SECTIONS[3:0:-1, [5, 6, 2, 3, 4, 0, 1, 8, 7]] * [1, 1, -1, 1, 1, 1, 1, 1, 1]
_ACROSS_THE_POLE = np.concatenate([_OVER, SECTIONS])
_KNOTS = np.arange(-3.0, N_KNOTS)
NEWTON_STEPS = 12
PROBE = 1e-5  # parameter step of the numerical Jacobian


def loft(angle_rad: Float[np.ndarray, " n"], height: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Place points of the featureless head.

    Args:
        angle_rad: around the head, 0 in front, positive towards the subject's left.
        height: section number from 0, the crown, to `N_KNOTS` - 1, the shoulders; between sections by fractions.

    Returns:
        (n, 3) metres.

    Source: own.
    """
    section = smooth_curve(_KNOTS, _ACROSS_THE_POLE, height)
    front_y, front_z, side_x, side_y, side_z, back_y, back_z, full_front, full_back = section.T
    c = np.cos(angle_rad)
    fullness = full_back + (full_front - full_back) * (1 + c) / 2
    x = np.sign(np.sin(angle_rad)) * side_x * np.sqrt(np.maximum(1 - np.abs(c) ** fullness, 0.0))
    y = side_y + c * ((front_y - back_y) / 2 + c * ((front_y + back_y) / 2 - side_y))
    z = side_z + c * ((front_z - back_z) / 2 + c * ((front_z + back_z) / 2 - side_z))
    return np.stack([x, y, z], axis=1)


def locate(
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    angle_rad: Float[np.ndarray, " n"],
    height: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Find the angle and height at which the front of the loft has the given x and y, by Newton's method from a first guess."""
    for _ in range(NEWTON_STEPS):
        here = loft(angle_rad, height)
        by_angle = (loft(angle_rad + PROBE, height) - here) / PROBE
        by_height = (loft(angle_rad, height + PROBE) - here) / PROBE
        determinant = by_angle[:, 0] * by_height[:, 1] - by_angle[:, 1] * by_height[:, 0]
        dx, dy = x - here[:, 0], y - here[:, 1]
        angle_rad = angle_rad + (dx * by_height[:, 1] - dy * by_height[:, 0]) / determinant
        height = height + (dy * by_angle[:, 0] - dx * by_angle[:, 1]) / determinant
    return angle_rad, height
