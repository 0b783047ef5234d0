"""An avatar's Gaussians as point attributes: what programs with z up that draw splats, such as Blender, take as it is.

A folder of splats holds one `.npy` for each array of `Splats` and, written last, `splats.json` with its plain values.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.binding import sigmoid, to_world
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.files import write_aside
from sacha_core.geometry import quaternion
from sacha_core.geometry.triangle import TriangleFrames
from sacha_core.raster.harmonic_turns import turned_harmonics
from sacha_core.raster.kernels.harmonics import BASIS
from sacha_core.scene.part import part_of

__all__ = ["Z_UP", "Splats", "splats_of", "write_splats"]

Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float64)  # from y up, z forward to z up, -y forward


@dataclass(frozen=True)
class Splats:
    """n Gaussians in a pose, and in the frames of the triangles that carry them. World axes: z up, -y forward. float32.

    Args:
        position: (n, 3) means, metres.
        scale: (n, 3) standard deviations, metres.
        rotation: (n, 4) unit quaternions wxyz.
        color: (n, 4) colour of degree 0 as linear light, not below 0, and opacity.
        sh: (n, k, 3) harmonics of degree 1 and up, of the colour before it becomes linear, in 3D Gaussian Splatting's order.
        binding: (n,) int32 triangle that carries each.
        position_local: (n, 3) means in the triangle's frame, in units of its scale.
        scale_local: (n, 3) standard deviations in units of the triangle's scale.
        rotation_local: (n, 4) unit quaternions wxyz in the triangle's frame.
        n_faces: triangles of the head.
        sh_degree: of the harmonics, 0 to 3.
    """

    position: Float[np.ndarray, "n 3"]
    scale: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, "n 4"]
    color: Float[np.ndarray, "n 4"]
    sh: Float[np.ndarray, "n k 3"]
    binding: Int[np.ndarray, " n"]
    position_local: Float[np.ndarray, "n 3"]
    scale_local: Float[np.ndarray, "n 3"]
    rotation_local: Float[np.ndarray, "n 4"]
    n_faces: int
    sh_degree: int


def splats_of(gaussians: Gaussians, frames: TriangleFrames) -> Splats:
    """Lay Gaussians out for a program with z up.

    Args:
        gaussians: n canonical Gaussians.
        frames: of each triangle of the posed head, y up.

    Raises:
        GeometryError: a Gaussian is bound to a triangle that has no frame.
    """
    world = to_world(gaussians, frames)
    srgb = np.maximum(gaussians.sh_dc.astype(np.float64) * BASIS[0] + 0.5, 0)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    opacity = sigmoid(gaussians.opacity_logit.astype(np.float64))
    with np.errstate(over="ignore"):
        scale_local = np.exp(gaussians.log_scale)
    up = quaternion.from_matrix(Z_UP).astype(np.float32)
    return Splats(
        position=(world.means @ Z_UP.T).astype(np.float32),
        scale=world.scales,
        rotation=quaternion.multiply(up, world.quaternions),
        color=np.concatenate([linear, opacity[:, None]], axis=1).astype(np.float32),
        sh=turned_harmonics(gaussians.sh_rest, Z_UP),
        binding=gaussians.binding.astype(np.int32, copy=False),
        position_local=gaussians.position,
        scale_local=scale_local,
        rotation_local=quaternion.normalise(gaussians.quaternion),
        n_faces=len(frames.scale),
        sh_degree=gaussians.sh_degree,
    )


def write_splats(splats: Splats, folder: Path) -> None:
    """Write the arrays, and last `splats.json`: a folder that has it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    part = part_of(splats)
    for name, array in part.arrays.items():
        with write_aside(folder / f"{name}.npy") as aside:
            np.save(aside, array, allow_pickle=False)
    with write_aside(folder / "splats.json") as aside:
        aside.write_text(json.dumps(part.values) + "\n", encoding="utf-8")
