"""From canonical Gaussians to the world, along the triangles that carry them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import GeometryError
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames

__all__ = ["WorldGaussians", "initial_gaussians", "sigmoid", "to_world"]

BLOCK = 2048  # Gaussians at a time, so that intermediate results stay in the cache and in memory already at hand
INITIAL_OPACITY = 0.1
LARGEST_INITIAL_DC = 1 / 255  # GaussianAvatars writes random colours in [0, 1) / 255 into the coefficient itself: grey


@dataclass(frozen=True)
class WorldGaussians:
    """n Gaussians in the world, activated, float32: what a rasteriser takes, but for colour.

    Args:
        means: (n, 3) metres.
        scales: (n, 3) standard deviations, metres.
        quaternions: (n, 4) wxyz, unit length.
        opacities: (n,) in (0, 1).
    """

    means: Float[np.ndarray, "n 3"]
    scales: Float[np.ndarray, "n 3"]
    quaternions: Float[np.ndarray, "n 4"]
    opacities: Float[np.ndarray, " n"]


def initial_gaussians(n_faces: int, rng: np.random.Generator, sh_degree: int = 3) -> Gaussians:
    """Give the Gaussians that training starts from: one at the centre of each triangle, as large as it, nearly grey and faint.

    Args:
        n_faces: triangles of the head.
        rng: source of the colours.
        sh_degree: highest degree that the coefficients shall have room for, 0 to 3.

    Returns:
        n_faces Gaussians, Gaussian i on triangle i.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2, and its public initialisation.
    """
    n = n_faces
    quaternions = np.zeros((n, 4), np.float32)
    quaternions[:, 0] = 1
    return Gaussians(
        position=np.zeros((n, 3), np.float32),
        log_scale=np.zeros((n, 3), np.float32),
        quaternion=quaternions,
        opacity_logit=np.full(n, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)), np.float32),
        sh_dc=rng.random((n, 3), np.float32) * np.float32(LARGEST_INITIAL_DC),
        sh_rest=np.zeros((n, (sh_degree + 1) ** 2 - 1, 3), np.float32),
        binding=np.arange(n, dtype=np.int32),
    )


def to_world(gaussians: Gaussians, frames: TriangleFrames) -> WorldGaussians:
    """Carry Gaussians along with their triangles.

    Mean: scale, turn and move by the frame. Standard deviations: times the frame's scale. Rotation: the triangle's after the Gaussian's
    own. Spherical harmonics are not turned: their axes are the world's.

    Args:
        gaussians: n canonical Gaussians.
        frames: frame of each triangle of the posed head.

    Returns:
        The n Gaussians in the world, in the same order.

    Raises:
        GeometryError: a Gaussian is bound to a triangle that has no frame.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4.
    """
    binding = gaussians.binding
    if len(binding) and not (binding.min() >= 0 and binding.max() < len(frames.scale)):
        row = int(np.argmax((binding < 0) | (binding >= len(frames.scale))))
        raise GeometryError(
            f"Gaussian {row} is bound to triangle {binding[row]}; the mesh has triangles 0 to {len(frames.scale) - 1}"
        )
    n = len(binding)
    means, scales = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    quaternions = np.empty((n, 4), np.float32)
    turns = quaternion.from_matrix(frames.rotation)
    for start in range(0, n, BLOCK):
        rows = slice(start, start + BLOCK)
        face = binding[rows]
        scale = frames.scale[face, None]
        turned = np.einsum("nij,nj->ni", frames.rotation[face], gaussians.position[rows])
        means[rows] = turned * scale + frames.origin[face]
        with np.errstate(over="ignore"):  # a Gaussian without end is culled when it is drawn
            scales[rows] = np.exp(gaussians.log_scale[rows]) * scale
        quaternions[rows] = quaternion.multiply(turns[face], quaternion.normalise(gaussians.quaternion[rows]))
    opacities = sigmoid(gaussians.opacity_logit).astype(np.float32, copy=False)
    return WorldGaussians(means, scales, quaternions, opacities)


def sigmoid(logit: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Logistic function through tanh, which neither overflows nor cancels."""
    value: np.ndarray = (1 + np.tanh(logit / 2)) / 2
    return value
