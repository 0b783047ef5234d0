"""What makes one person differ from another: a name and a field for each identity component, one unit of it a standard deviation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.anatomy import MIRROR, Anatomy
from sacha_core.flame.synthetic.ears import EAR_CENTRE
from sacha_core.flame.synthetic.eyes import EYE_CENTRE
from sacha_core.flame.synthetic.fields import Push, eye_nearness, push_field
from sacha_core.flame.synthetic.mouth import MOUTH_LINE
from sacha_core.flame.synthetic.spline import smooth_step

__all__ = ["IDENTITY", "identity_directions"]

# Stretches about a point: pivot and strain along each axis, and between which heights y it sets in (None: everywhere).
_STRETCHES: dict[str, tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float] | None]] = {
    "size": ((0.0, -0.05, -0.05), (0.030, 0.030, 0.030), None),
    "head_width": ((0.0, 0.0, 0.0), (0.040, 0.0, 0.0), (-0.12, 0.0)),
    "head_length": ((0.0, 0.0, -0.01), (0.0, 0.0, 0.040), (-0.10, 0.0)),
    "skull_height": ((0.0, 0.045, 0.0), (0.0, 0.070, 0.0), (0.045, 0.09)),
    "face_length": ((0.0, 0.01, 0.0), (0.0, 0.040, 0.0), (0.01, -0.03)),
    "face_width": ((0.0, 0.0, 0.0), (0.035, 0.0, 0.0), (0.05, -0.02)),
    "neck_width": ((0.0, 0.0, -0.055), (0.070, 0.0, 0.050), (-0.095, -0.135)),
}
_PUSHES: dict[str, tuple[Push, ...]] = {
    "jaw_width": (Push((0.055, -0.068, -0.020), (0.022, 0.022, 0.032), (0.0040, 0.0, 0.0), "both"),),
    "jaw_angle": (Push((0.056, -0.074, -0.040), (0.020, 0.016, 0.022), (0.0012, -0.0045, -0.0020), "both"),),
    "chin_length": (Push((0.0, -0.096, 0.045), (0.024, 0.016, 0.030), (0.0, -0.0040, 0.0)),),
    "chin_forward": (Push((0.0, -0.092, 0.050), (0.022, 0.016, 0.026), (0.0, 0.0, 0.0040)),),
    "chin_width": (Push((0.017, -0.090, 0.045), (0.012, 0.014, 0.020), (0.0028, 0.0, 0.0006), "both"),),
    "double_chin": (Push((0.0, -0.112, 0.015), (0.026, 0.014, 0.024), (0.0, -0.0050, 0.0020)),),
    "nose_length": (Push((0.0, -0.020, 0.065), (0.018, 0.013, 0.026), (0.0, -0.0028, 0.0)),),
    "nose_forward": (Push((0.0, -0.015, 0.072), (0.012, 0.014, 0.022), (0.0, 0.0, 0.0030)),),
    "nose_width": (Push((0.013, -0.019, 0.060), (0.0075, 0.010, 0.018), (0.0020, 0.0, 0.0), "both"),),
    "nose_bridge": (Push((0.0, 0.010, 0.060), (0.0085, 0.011, 0.020), (0.0, 0.0, 0.0024)),),
    "nose_tip": (Push((0.0, -0.015, 0.075), (0.009, 0.008, 0.014), (0.0, 0.0024, 0.0)),),
    "cheek_fullness": (Push((0.045, -0.035, 0.020), (0.017, 0.020, 0.024), (0.0030, 0.0, 0.0024), "both"),),
    "cheekbones": (Push((0.050, -0.004, 0.025), (0.015, 0.010, 0.020), (0.0020, 0.0, 0.0026), "both"),),
    "brow_ridge": (Push((0.020, 0.042, 0.052), (0.022, 0.0075, 0.020), (0.0, 0.0, 0.0024), "both"),),
    "brow_height": (Push((0.028, 0.044, 0.048), (0.018, 0.0100, 0.022), (0.0, 0.0026, 0.0), "both"),),
    "forehead_slope": (Push((0.0, 0.085, 0.045), (0.050, 0.022, 0.040), (0.0, 0.0, -0.0040)),),
    "temples": (Push((0.070, 0.045, 0.005), (0.018, 0.022, 0.024), (-0.0024, 0.0, 0.0), "both"),),
    "occiput": (Push((0.0, 0.020, -0.145), (0.050, 0.035, 0.040), (0.0, 0.0, -0.0050)),),
    "upper_lip": (Push((0.0, MOUTH_LINE + 0.007, 0.058), (0.017, 0.0040, 0.010), (0.0, 0.0011, 0.0013), lip="upper"),),
    "lower_lip": (Push((0.0, MOUTH_LINE - 0.008, 0.058), (0.017, 0.0048, 0.010), (0.0, -0.0012, 0.0014), lip="lower"),),
    "mouth_width": (Push((0.0245, MOUTH_LINE, 0.045), (0.010, 0.012, 0.012), (0.0028, 0.0, -0.0010), "both"),),
    "mouth_forward": (Push((0.0, MOUTH_LINE, 0.055), (0.024, 0.020, 0.045), (0.0, 0.0, 0.0024)),),
    "eye_spacing": (Push((0.0325, 0.019, 0.030), (0.017, 0.016, 0.024), (0.0014, 0.0, 0.0), "both"),),
    "eye_depth": (Push((0.0325, 0.019, 0.030), (0.017, 0.015, 0.024), (0.0, 0.0, 0.0016), "both"),),
    "eye_height": (Push((0.0325, 0.019, 0.030), (0.018, 0.018, 0.024), (0.0, 0.0016, 0.0), "both"),),
    "larynx": (Push((0.0, -0.134, -0.004), (0.011, 0.011, 0.018), (0.0, 0.0, 0.0024)),),
}
EAR_SIZE_STRAIN = 0.10
EAR_FLARE_M = 0.0034
IDENTITY = (*_STRETCHES, *_PUSHES, "ear_size", "ear_flare")


def identity_directions(anatomy: Anatomy) -> Float[np.ndarray, "v 3 s"]:
    """Give the displacement of every vertex for one standard deviation of each component of `IDENTITY`.

    An eyeball keeps its shape and its lids go with it, whatever happens to the face around them.

    Args:
        anatomy: the mean head.

    Returns:
        (v, 3, s) metres.

    Source: own.
    """
    left = np.asarray(EYE_CENTRE)
    points = np.concatenate([anatomy.vertices, [left, left * MIRROR]])
    near = eye_nearness(anatomy)
    for side, name in enumerate(("left_eyeball", "right_eyeball")):
        near[side, anatomy.parts[name]] = 1.0
    rest = 1 - near.sum(axis=0)
    directions = []
    for name in IDENTITY:
        field = _field(name, points, anatomy)
        free, eyes = field[:-2], field[-2:]
        directions.append(rest[:, None] * free + near.T @ eyes)
    return np.stack(directions, axis=2)


def _field(name: str, points: Float[np.ndarray, "n 3"], anatomy: Anatomy) -> Float[np.ndarray, "n 3"]:
    if name in _STRETCHES:
        pivot, strain, onset = _STRETCHES[name]
        share = np.ones(len(points)) if onset is None else smooth_step(points[:, 1], *onset)
        return share[:, None] * (points - pivot) * strain
    if name in _PUSHES:
        return push_field(points, _PUSHES[name])
    return _ear_field(name, points, anatomy)


def _ear_field(name: str, points: Float[np.ndarray, "n 3"], anatomy: Anatomy) -> Float[np.ndarray, "n 3"]:
    field = np.zeros_like(points)
    for sign, side in ((1, "left_ear"), (-1, "right_ear")):
        centre = np.asarray(EAR_CENTRE) * [sign, 1, 1]
        for part, ids in anatomy.parts.items():
            if not part.startswith(side) or part.endswith("/root"):
                continue
            share = 0.5 if part.endswith("/behind") else 1.0
            away = points[ids] - centre
            if name == "ear_size":
                field[ids] = share * EAR_SIZE_STRAIN * away
            else:
                field[ids, 0] = share * sign * EAR_FLARE_M * np.clip(-away[:, 2] / 0.02, 0.0, 1.5)
    return field
