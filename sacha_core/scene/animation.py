"""A motion as the values of a rig's controls, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.flame.posing import TURNS
from sacha_core.geometry.quaternion import from_matrix
from sacha_core.geometry.rotation import rotation_vectors_to_matrices
from sacha_core.scene.rig import Rig

__all__ = ["Animation", "animation_of"]


@dataclass(frozen=True)
class Animation:
    """t frames of a rig's controls.

    Args:
        frame_rate: frames a second.
        values: (t, k) of the expressions; see `Rig.scales`.
        quaternions: (t, j, 4) wxyz of each joint relative to its parent; neighbours in time lie on one side.
        translation: (t, 3) of the root, metres, y up.
    """

    frame_rate: float
    values: Float[np.ndarray, "t k"]
    quaternions: Float[np.ndarray, "t j 4"]
    translation: Float[np.ndarray, "t 3"]


def animation_of(motion: Motion, rig: Rig) -> Animation:
    """Give a motion as the values of the controls of the rig that was made for it."""
    values = np.zeros((len(motion), len(rig.names)))
    expressions = values[:, rig.n_identity :]
    n_used = min(motion.expression.shape[1], expressions.shape[1])  # the rest is zero: the rig was checked against it
    expressions[:, :n_used] = motion.expression[:, :n_used] / rig.scales[rig.n_identity :][:n_used]
    vectors = np.concatenate([getattr(motion, name) for name in TURNS], axis=1).reshape(len(motion), -1, 3)
    vectors = vectors[:, : len(rig.joint_names)].astype(np.float64)
    quaternions = from_matrix(rotation_vectors_to_matrices(vectors))
    return Animation(
        motion.frame_rate,
        values.astype(np.float32),
        one_side(quaternions).astype(np.float32),
        motion.translation.astype(np.float32, copy=False),
    )


def one_side(quaternions: Float[np.ndarray, "t j 4"]) -> Float[np.ndarray, "t j 4"]:
    """Choose signs so that each quaternion is nearer to the one before it than its opposite, for what lies between frames."""
    turned = np.einsum("tjc,tjc->tj", quaternions[1:], quaternions[:-1]) < 0
    signs = np.cumprod(np.where(turned, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])
