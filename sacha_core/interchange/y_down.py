"""Gaussians turned over, for programs that take y for down, as the scenes of 3D Gaussian Splatting have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.geometry import quaternion

__all__ = ["turned_over"]

HALF_TURN = (0.0, 0.0, 0.0, 1.0)  # about z, wxyz: what looked ahead still does
ORDERS = np.concatenate([np.arange(-degree, degree + 1) for degree in range(1, 4)])  # of the harmonics after degree 0


def turned_over(gaussians: Gaussians) -> Gaussians:
    """Turn Gaussians that stand in the world half round the z axis, harmonics and all; twice gives back what was.

    Splat viewers turn a PLY so when they show it, and programs that convert one to glTF, whose y is up, when they read it.

    Args:
        gaussians: in the world.

    Source: own; a harmonic of order m is even or odd in (x, y) as m is.
    """
    half = np.array(HALF_TURN, gaussians.quaternion.dtype)
    sign = np.where(ORDERS % 2 == 0, 1, -1).astype(gaussians.sh_rest.dtype)
    return replace(
        gaussians,
        position=gaussians.position * np.array([-1, -1, 1], gaussians.position.dtype),
        quaternion=quaternion.multiply(half, gaussians.quaternion),
        sh_rest=gaussians.sh_rest * sign[: gaussians.sh_rest.shape[1], None],
    )
