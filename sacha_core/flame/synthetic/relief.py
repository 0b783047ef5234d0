"""What makes a face of the loft: sockets, brows, nose, cheeks, chin, throat."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.spline import bump, smooth_curve, smooth_step

__all__ = ["NOSE_TIP", "relief"]

NOSE_TIP = (0.0, -0.0165, 0.0745)

# Soft mounds and dents on the front of the head, in metres: centre (x, y), radius (x, y), displacement (x, y, z). Off the middle each
# has its mirror image.
_Mound = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
_FRONT: tuple[_Mound, ...] = (
    ((0.0290, 0.0200), (0.0120, 0.0095), (0.0, 0.0, -0.0050)),  # eye socket
    ((0.0480, 0.0220), (0.0070, 0.0140), (0.0, 0.0, 0.0024)),  # outer rim of the orbit
    ((0.0180, 0.0225), (0.0060, 0.0085), (0.0, 0.0, -0.0032)),  # its inner corner
    ((0.0270, 0.0425), (0.0150, 0.0065), (0.0, 0.0, 0.0026)),  # brow ridge
    ((0.0000, 0.0430), (0.0100, 0.0080), (0.0, 0.0, 0.0015)),  # between the brows
    ((0.0250, 0.0800), (0.0180, 0.0140), (0.0, 0.0, 0.0020)),  # eminences of the forehead
    ((0.0620, 0.0400), (0.0100, 0.0180), (-0.0020, 0.0, 0.0)),  # temple
    ((0.0460, -0.0050), (0.0160, 0.0130), (0.0012, 0.0, 0.0044)),  # cheekbone
    ((0.0300, -0.0120), (0.0120, 0.0120), (0.0, 0.0, 0.0020)),  # apple of the cheek
    ((0.0500, -0.0480), (0.0120, 0.0140), (-0.0020, 0.0, -0.0020)),  # hollow of the cheek
    ((0.0240, -0.0300), (0.0055, 0.0105), (0.0, 0.0, -0.0020)),  # fold from nose to mouth
    ((0.0000, -0.0350), (0.0030, 0.0045), (0.0, 0.0, -0.0013)),  # philtrum
    ((0.0000, -0.0510), (0.0200, 0.0140), (0.0, 0.0, 0.0040)),  # the round of the jaws under the lips
    ((0.0340, -0.0560), (0.0060, 0.0090), (0.0, 0.0, -0.0015)),  # beside the corner of the mouth
    ((0.0000, -0.0690), (0.0160, 0.0045), (0.0, 0.0, -0.0030)),  # hollow over the chin
    ((0.0000, -0.0900), (0.0140, 0.0105), (0.0, 0.0, 0.0070)),  # chin
    ((0.0120, -0.0930), (0.0090, 0.0090), (0.0, 0.0, 0.0015)),  # its corners
)
# The same anywhere on the head: centre, radius and displacement in x, y, z.
_ALL_ROUND: tuple[_Mound, ...] = (
    ((0.0560, -0.0720, -0.0350), (0.0200, 0.0130, 0.0200), (0.0045, -0.0010, 0.0)),  # angle of the jaw
    ((0.0000, -0.1330, -0.0060), (0.0090, 0.0090, 0.0150), (0.0, 0.0, 0.0025)),  # larynx
    ((0.0300, -0.1500, -0.0200), (0.0110, 0.0300, 0.0200), (0.0015, 0.0, 0.0030)),  # the long muscle of the neck
    ((0.0160, -0.1750, 0.0050), (0.0120, 0.0120, 0.0200), (0.0, 0.0, 0.0025)),  # where it meets the breastbone
    ((0.0000, -0.1800, 0.0050), (0.0060, 0.0090, 0.0200), (0.0, 0.0, -0.0040)),  # the hollow between
    ((0.0000, -0.1000, -0.1060), (0.0100, 0.0250, 0.0200), (0.0, 0.0, 0.0030)),  # hollow of the nape
)
# Ridge of the nose: height, how far it stands out, how broad it is (standard deviation).
_RIDGE = np.array(
    [
        [0.0440, 0.0000, 0.0085],
        [0.0340, 0.0010, 0.0070],
        [0.0240, 0.0040, 0.0056],
        [0.0120, 0.0105, 0.0054],
        [0.0000, 0.0170, 0.0062],
        [-0.0100, 0.0222, 0.0072],
        [-0.0160, 0.0240, 0.0074],
        [-0.0205, 0.0215, 0.0070],
        [-0.0250, 0.0140, 0.0066],
        [-0.0290, 0.0060, 0.0066],
        [-0.0330, 0.0015, 0.0070],
        [-0.0380, 0.0000, 0.0070],
    ]
)
_NOSE: tuple[_Mound, ...] = (
    ((0.0000, -0.0165), (0.0058, 0.0055), (0.0, -0.0008, 0.0024)),  # tip
    ((0.0000, -0.0220), (0.0066, 0.0048), (0.0, -0.0026, 0.0)),  # and how it hangs over
    ((0.0126, -0.0188), (0.0041, 0.0048), (0.0016, -0.0004, 0.0084)),  # wing
    ((0.0182, -0.0200), (0.0026, 0.0058), (-0.0006, 0.0, -0.0034)),  # groove behind the wing
    ((0.0084, -0.0170), (0.0022, 0.0035), (0.0, 0.0, -0.0014)),  # groove before it
    ((0.0066, -0.0258), (0.0026, 0.0022), (0.0, 0.0044, -0.0052)),  # nostril
)


def relief(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Displacement that turns points of the loft into points of the head, eyes, lips and ears still missing.

    Args:
        points: (n, 3) on the loft, metres.

    Returns:
        (n, 3) metres.

    Source: own.
    """
    in_front = smooth_step(points[:, 2], -0.040, -0.005)
    moved = np.zeros_like(points)
    for centre, radius, displacement in _FRONT + _NOSE:
        moved += _mirrored(points, centre, radius, displacement) * in_front[:, None]
    for centre, radius, displacement in _ALL_ROUND:
        moved += _mirrored(points, centre, radius, displacement)
    moved[:, 2] += _ridge(points) * in_front
    return moved


def _mirrored(
    points: Float[np.ndarray, "n 3"],
    centre: tuple[float, ...],
    radius: tuple[float, ...],
    displacement: tuple[float, ...],
) -> Float[np.ndarray, "n 3"]:
    along = np.asarray(displacement)
    moved: Float[np.ndarray, "n 3"] = bump(points, centre, radius)[:, None] * along
    if centre[0] != 0:
        moved += bump(points, (-centre[0], *centre[1:]), radius)[:, None] * (along * [-1, 1, 1])
    return moved


def _ridge(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    order = _RIDGE[::-1]
    y = np.clip(points[:, 1], order[0, 0], order[-1, 0])
    height, breadth = smooth_curve(order[:, 0], order[:, 1:], y).T
    ridge: Float[np.ndarray, " n"] = np.maximum(height, 0.0) * np.exp(-0.5 * np.abs(points[:, 0] / breadth) ** 2.2)
    return ridge
