"""Canonical Gaussians into the world, along the triangles that carry them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from sacha_core.animation.kernels.carry import BLOCK
from sacha_core.animation.kernels.carry import carry as carry_range
from sacha_core.animation.posed import block_bounds
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.parallel.pool import Pool

__all__ = ["Carried", "carry", "room_for"]

Carried = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]


class Turned(Protocol):
    """What Gaussians are carried by: a `Pose`, or less.

    Attributes:
        frames: of the f triangles.
        quaternions: (f, 4) wxyz of the frames' rotations.
    """

    @property
    def frames(self) -> TriangleFrames: ...

    @property
    def quaternions(self) -> Float[np.ndarray, "f 4"]: ...


def room_for(n: int, dtype: DTypeLike = np.float32) -> Carried:
    """Give arrays for means, scales and quaternions of n Gaussians, to be written."""
    return np.empty((n, 3), dtype), np.empty((n, 3), dtype), np.empty((n, 4), dtype)


def carry(
    position: Float[np.ndarray, "n 3"],
    log_scale: Float[np.ndarray, "n 3"],
    quaternion: Float[np.ndarray, "n 4"],
    binding: Int[np.ndarray, " n"],
    pose: Turned,
    pool: Pool | None = None,
    out: Carried | None = None,
) -> Carried:
    """Carry Gaussians along with their triangles: the compiled twin of `sacha_core.avatar.binding.to_world`.

    Args:
        position: (n, 3) in units of the triangle.
        log_scale: (n, 3) natural logarithm of the standard deviations in units of the triangle.
        quaternion: (n, 4) wxyz, of any length.
        binding: (n,) triangle of each; not checked here, since this runs at every frame.
        pose: of the head, in the dtype of the above: a `Pose`, or what has its frames and their quaternions.
        pool: shares out the work; None for the calling thread alone.
        out: from `room_for`, to be written.

    Returns:
        Means (n, 3) and standard deviations (n, 3) in metres and unit quaternions (n, 4), in the world: `out` where it was given. The same
        bits for any number of threads.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4.
    """
    n = len(binding)
    means, scales, turned = out or room_for(n, position.dtype)
    frames = pose.frames
    pool = pool or Pool(1)
    bounds = block_bounds(n, BLOCK, pool.threads)

    def job(_: int, k: int) -> None:
        rows = slice(bounds[k], bounds[k + 1])
        with np.errstate(over="ignore"):  # a Gaussian without end is culled when it is drawn
            np.exp(log_scale[rows], out=scales[rows])
        carry_range(
            rows.start, rows.stop, position, scales, quaternion, binding,
            frames.rotation, frames.scale, frames.origin, pose.quaternions, means, scales, turned,
        )  # fmt: skip

    pool.run(job, len(bounds) - 1)
    return means, scales, turned
