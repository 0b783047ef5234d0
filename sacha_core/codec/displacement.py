"""How far each parameter of a frame moves the vertices: what a quantiser's error is worth.

Only the encoder needs this.

Source: own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser

__all__ = ["displacement_products", "error_of"]

TURN_RAD = 2.0**-12  # by which joints are turned, either way, to see what moves
N_ANGLES = 15


def displacement_products(head: HeadModel, motion: Motion) -> Float[np.ndarray, "p p"]:
    """Give inner products of the displacements by one unit of each parameter, of the person at rest, averaged over vertices.

    Args:
        head: the head model.
        motion: whose static parameters make the person; its frames do not matter.

    Returns:
        (p, p) square metres a unit of either parameter, in the order of a frame: expression, rotation, neck, jaw, eyes, translation. Rows
        of expression components that the head lacks are zero.

    Raises:
        HeadError: the motion has offsets for other vertices than the head's.
    """
    n_known = min(motion.expression.shape[1], head.exprdirs.shape[2])
    shape = motion.shape[: head.shapedirs.shape[2]]
    turned = Motion.rest(len(shape), 0, 2 * N_ANGLES)
    angles = np.zeros((2 * N_ANGLES, N_ANGLES), np.float32)
    angles[np.arange(2 * N_ANGLES), np.arange(2 * N_ANGLES) // 2] = np.tile([TURN_RAD, -TURN_RAD], N_ANGLES)
    rotation, neck, jaw, eyes = np.split(angles, [3, 6, 9], axis=1)
    turned = replace(
        turned, shape=shape, static_offset=motion.static_offset, rotation=rotation, neck=neck, jaw=jaw, eyes=eyes
    )
    poser = Poser(head, turned, np.float64)
    v, first = head.n_vertices, motion.expression.shape[1]
    moved = np.zeros((3 * v, first + N_ANGLES + 3))
    moved[:, :n_known] = head.exprdirs[:, :, :n_known].reshape(3 * v, n_known)
    for angle in range(N_ANGLES):
        moved[:, first + angle] = ((poser(2 * angle) - poser(2 * angle + 1)) / (2 * TURN_RAD)).reshape(-1)
    moved[:, first + N_ANGLES :] = np.tile(np.eye(3), (v, 1))
    return np.asarray(moved.T @ moved / v)


def error_of(off: Float[np.ndarray, "t p"], products: Float[np.ndarray, "p p"]) -> float:
    """Give the error of vertices (norm, RMS over vertices and frames, metres) where parameters are off by so much."""
    if not len(off):
        return 0.0
    return float(np.sqrt(max(np.einsum("tp,tp->t", off @ products, off).mean(), 0.0)))
