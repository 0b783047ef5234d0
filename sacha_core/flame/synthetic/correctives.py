"""Pose correctives: what skin does beside following its joints."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from sacha_core.flame.synthetic.anatomy import Anatomy
from sacha_core.flame.synthetic.fields import Push, eye_nearness, push_field
from sacha_core.flame.synthetic.lids import turn_lids
from sacha_core.flame.synthetic.skinning import JAW, LEFT_EYE, PARENTS, RIGHT_EYE

__all__ = ["pose_directions"]

LID_FOLLOWS_GAZE = (0.62, 0.30)  # share of the eye's pitch that the upper and the lower lid take over
# Per unit sine of the jaw's opening: the corners of the mouth draw in, the cheeks hollow.
_JAW_OPENS = (
    Push((0.0245, -0.0515, 0.0410), (0.0110, 0.0120, 0.0200), (-0.0120, 0.0, 0.0030), "both"),
    Push((0.0480, -0.0450, 0.0100), (0.0140, 0.0180, 0.0240), (-0.0060, 0.0, -0.0020), "both"),
)


def pose_directions(anatomy: Anatomy) -> Float[np.ndarray, "v 3 p"]:
    """Give the displacement of every vertex per unit of each entry of the joints' rotation matrices less the identity.

    Args:
        anatomy: the mean head.

    Returns:
        (v, 3, 36) metres; FLAME's order: joints 1 to 4, each matrix by rows.

    Source: own; the form is that of Li et al., FLAME, SIGGRAPH Asia 2017.
    """
    directions = np.zeros((len(anatomy.vertices), 3, 9 * (len(PARENTS) - 1)))
    skin = np.zeros(len(anatomy.vertices))
    skin[anatomy.parts["skin"]] = 1.0
    skin *= 1 - eye_nearness(anatomy).sum(axis=0)
    directions[:, :, _sine_of_pitch(JAW)] = skin[:, None] * push_field(anatomy.vertices, _JAW_OPENS)
    for joint, side in ((LEFT_EYE, "left"), (RIGHT_EYE, "right")):
        turn = anatomy.skin.patches[f"{side}_eye"].turn_rad
        sin = np.sin(turn)
        # Small turns are linear: the displacement of a tenth of a radian, ten times. Pitch is positive downwards.
        share = np.where(sin > 0, LID_FOLLOWS_GAZE[0], LID_FOLLOWS_GAZE[1]) * np.abs(sin)
        directions[:, :, _sine_of_pitch(joint)] = turn_lids(anatomy, side, -0.1 * share) * 10
    return directions


def _sine_of_pitch(joint: int) -> int:
    """Place of row 2, column 1 of a joint's matrix, the sine of a turn about x, among the pose features."""
    return 9 * (joint - 1) + 3 * 2 + 1
