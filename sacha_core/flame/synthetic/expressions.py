"""What a face can do: a name and a field for each expression component.

1 is a full movement, with the jaw closed (opening it is the joint's).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.anatomy import Anatomy
from sacha_core.flame.synthetic.fields import Push, eye_nearness, push_field
from sacha_core.flame.synthetic.lids import close_lids
from sacha_core.flame.synthetic.mouth import MOUTH_LINE

__all__ = ["EXPRESSIONS", "expression_directions"]

_Y = MOUTH_LINE
_CORNER = (0.0245, _Y, 0.041)
_UPPER_LIP, _LOWER_LIP = (0.0, _Y + 0.006, 0.057), (0.0, _Y - 0.007, 0.056)

# Movements of the subject's left half; each has its mirror image on the right.
_SIDED: dict[str, tuple[Push, ...]] = {
    "smile": (
        Push(_CORNER, (0.0120, 0.0110, 0.020), (0.0062, 0.0068, -0.0050)),
        Push((0.036, -0.020, 0.040), (0.0130, 0.0110, 0.020), (0.0008, 0.0034, 0.0026)),
    ),
    "frown": (
        Push(_CORNER, (0.0110, 0.0110, 0.020), (0.0016, -0.0060, -0.0012)),
        Push((0.024, -0.075, 0.042), (0.0100, 0.0090, 0.016), (0.0, -0.0016, 0.0008)),
    ),
    "mouth_stretch": (Push(_CORNER, (0.0120, 0.0120, 0.020), (0.0060, -0.0022, -0.0050)),),
    "upper_lip_raise": (Push((0.011, _Y + 0.006, 0.055), (0.0090, 0.0110, 0.016), (0.0, 0.0052, 0.0008), lip="upper"),),
    "lower_lip_depress": (
        Push((0.011, _Y - 0.007, 0.054), (0.0090, 0.0110, 0.016), (0.0006, -0.0056, -0.0004), lip="lower"),
    ),
    "dimple": (Push((0.029, _Y + 0.001, 0.038), (0.0070, 0.0080, 0.016), (0.0018, 0.0010, -0.0036)),),
    "sneer": (
        Push((0.0150, -0.019, 0.055), (0.0070, 0.0090, 0.016), (0.0008, 0.0040, 0.0004)),
        Push((0.0140, _Y + 0.009, 0.052), (0.0080, 0.0080, 0.016), (0.0, 0.0030, 0.0006), lip="upper"),
    ),
    "cheek_puff": (Push((0.042, -0.046, 0.022), (0.0150, 0.0160, 0.022), (0.0068, 0.0, 0.0056)),),
    "cheek_raise": (Push((0.038, -0.008, 0.040), (0.0140, 0.0095, 0.020), (0.0, 0.0044, 0.0024)),),
    "brow_inner_raise": (Push((0.013, 0.044, 0.056), (0.0090, 0.0110, 0.020), (0.0, 0.0062, 0.0006)),),
    "brow_outer_raise": (Push((0.038, 0.045, 0.046), (0.0130, 0.0110, 0.020), (0.0, 0.0062, 0.0004)),),
    "brow_lower": (
        Push((0.014, 0.042, 0.056), (0.0110, 0.0090, 0.020), (-0.0026, -0.0050, 0.0010)),
        Push((0.030, 0.043, 0.050), (0.0110, 0.0080, 0.020), (-0.0008, -0.0022, 0.0004)),
    ),
}
_MIDDLE: dict[str, tuple[Push, ...]] = {
    "pucker": (
        Push(_CORNER, (0.0110, 0.0120, 0.018), (-0.0080, 0.0, 0.0034), "both"),
        Push((0.0, _Y, 0.058), (0.0140, 0.0110, 0.016), (0.0, 0.0, 0.0056)),
    ),
    "funnel": (
        Push(_UPPER_LIP, (0.0120, 0.0080, 0.014), (0.0, 0.0032, 0.0046), lip="upper"),
        Push(_LOWER_LIP, (0.0120, 0.0080, 0.014), (0.0, -0.0036, 0.0046), lip="lower"),
        Push(_CORNER, (0.0100, 0.0110, 0.018), (-0.0056, 0.0, 0.0020), "both"),
    ),
    "lip_press": (
        Push((0.0, _Y + 0.003, 0.057), (0.0190, 0.0050, 0.012), (0.0, -0.0010, -0.0014), lip="upper"),
        Push((0.0, _Y - 0.003, 0.056), (0.0190, 0.0050, 0.012), (0.0, 0.0011, -0.0014), lip="lower"),
    ),
    "upper_lip_roll_out": (
        Push((0.0, _Y + 0.004, 0.058), (0.0150, 0.0045, 0.012), (0.0, 0.0016, 0.0026), lip="upper"),
    ),
    "lower_lip_roll_out": (
        Push((0.0, _Y - 0.005, 0.057), (0.0150, 0.0050, 0.012), (0.0, -0.0018, 0.0028), lip="lower"),
    ),
    "lips_part": (
        Push(_UPPER_LIP, (0.0150, 0.0120, 0.016), (0.0, 0.0026, 0.0), lip="upper"),
        Push(_LOWER_LIP, (0.0150, 0.0130, 0.016), (0.0, -0.0034, 0.0), lip="lower"),
    ),
    "chin_raise": (
        Push((0.0, -0.085, 0.048), (0.0150, 0.0110, 0.020), (0.0, 0.0042, 0.0016)),
        Push(_LOWER_LIP, (0.0130, 0.0060, 0.014), (0.0, 0.0004, 0.0026), lip="lower"),
    ),
    "mouth_left": (Push((0.0, _Y, 0.052), (0.0230, 0.0150, 0.020), (0.0072, 0.0, 0.0)),),
    "jaw_left": (Push((0.0, -0.080, 0.045), (0.0280, 0.0200, 0.030), (0.0060, 0.0, 0.0)),),
    "nostril_flare": (Push((0.0145, -0.021, 0.057), (0.0055, 0.0070, 0.014), (0.0020, 0.0004, -0.0002), "both"),),
    "throat_lower": (Push((0.0, -0.118, 0.005), (0.0200, 0.0140, 0.020), (0.0, -0.0050, 0.0010)),),
}
# How far the upper and the lower lid of one eye go towards closing.
_LIDS = {"blink": (1.0, 1.0), "squint": (0.30, 1.5), "wide": (-0.30, -0.60)}

EXPRESSIONS = (*(f"{name}_{side}" for name in (*_SIDED, *_LIDS) for side in ("left", "right")), *_MIDDLE)


def expression_directions(anatomy: Anatomy) -> Float[np.ndarray, "v 3 e"]:
    """Give the displacement of every vertex for each component of `EXPRESSIONS`; eyeballs and teeth stay.

    Args:
        anatomy: the mean head.

    Returns:
        (v, 3, e) metres.

    Source: own.
    """
    on_face = np.zeros(len(anatomy.vertices))
    on_face[anatomy.parts["skin"]] = 1.0
    on_face *= 1 - eye_nearness(anatomy).sum(axis=0)  # lids are moved by the lids' own components only
    directions = []
    for name in EXPRESSIONS:
        movement, _, side = name.rpartition("_")
        if movement in _LIDS:
            directions.append(close_lids(anatomy, side, *_LIDS[movement]))
        elif movement in _SIDED:
            pushes = _SIDED[movement] if side == "left" else tuple(push.mirrored() for push in _SIDED[movement])
            directions.append(on_face[:, None] * push_field(anatomy.vertices, pushes))
        else:
            directions.append(on_face[:, None] * push_field(anatomy.vertices, _MIDDLE[name]))
    return np.stack(directions, axis=2)
