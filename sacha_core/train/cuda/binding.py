"""Triangle frames and Gaussians that follow them, on a device, differentiable by torch: the twin of `sacha_core.animation`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from sacha_core.geometry.quaternion import SMALLEST_NORM
from sacha_core.geometry.triangle import degenerate_limit

__all__ = ["Frames", "carry", "triangle_frames"]


@dataclass(frozen=True)
class Frames:
    """Frames of f triangles.

    Args:
        table: (f, 17) rotation row by row, scale, origin and quaternion of each: one gather serves them all.
        sound: whether each has an area; the rows of others are not finite.
    """

    table: Float[Tensor, "f 17"]
    sound: Bool[Tensor, " f"]

    @property
    def scale(self) -> Float[Tensor, " f"]:
        """Metres a local unit."""
        return self.table[:, 9]


def triangle_frames(vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]) -> Frames:
    """Frame of each triangle: see `sacha_core.geometry.triangle`. A degenerate one is told, not refused: nothing waits for the device.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
    """
    p0, p1, p2 = vertices.index_select(0, faces.reshape(-1)).view(-1, 3, 3).unbind(1)
    edge, second = p1 - p0, p2 - p0
    normal = torch.linalg.cross(edge, second)
    edge_squared, normal_squared = (edge * edge).sum(1), (normal * normal).sum(1)
    kind = np.dtype(str(vertices.dtype).removeprefix("torch."))
    limit = degenerate_limit(kind) ** 2 * edge_squared * (second * second).sum(1)
    sound = (normal_squared > limit) & (normal_squared < torch.inf)
    sound &= (normal_squared >= np.finfo(kind).tiny) & (edge_squared >= np.finfo(kind).tiny)
    edge_length, normal_length = edge_squared.sqrt(), normal_squared.sqrt()
    scale = (edge_length + normal_length / edge_length) / 2
    edge, normal = edge / edge_length[:, None], normal / normal_length[:, None]
    rotation = torch.stack([edge, normal, torch.linalg.cross(edge, normal)], 2)
    origin = (p0 + p1 + p2) / 3
    return Frames(torch.cat([rotation.view(-1, 9), scale[:, None], origin, quaternions(rotation)], 1), sound)


def quaternions(rotation: Float[Tensor, "f 3 3"]) -> Float[Tensor, "f 4"]:
    """Give the unit quaternion of each matrix, its largest component positive: see `sacha_core.geometry.quaternion.from_matrix`.

    Source: Shepperd, Quaternion from rotation matrix, 1978.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation.view(-1, 9).unbind(1)
    wx, wy, wz = zy - yz, xz - zx, yx - xy
    sxy, sxz, syz = xy + yx, xz + zx, yz + zy
    w, x, y, z = 1 + xx + yy + zz, 1 + xx - yy - zz, 1 + yy - xx - zz, 1 + zz - xx - yy
    rows = torch.stack([w, wx, wy, wz, wx, x, sxy, sxz, wy, sxy, y, syz, wz, sxz, syz, z], 1).view(-1, 4, 4)
    largest = torch.stack([w, x, y, z], 1).argmax(1)
    return normalize(rows.gather(1, largest[:, None, None].expand(-1, 1, 4))[:, 0], dim=1, eps=SMALLEST_NORM)


def carry(
    position: Float[Tensor, "n 3"],
    log_scale: Float[Tensor, "n 3"],
    quaternion: Float[Tensor, "n 4"],
    binding: Int[Tensor, " n"],
    frames: Frames,
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"], Float[Tensor, "n 4"]]:
    """Carry Gaussians along with their triangles; give means and standard deviations, metres, and unit quaternions in the world.

    Args:
        position: (n, 3) in units of the triangle.
        log_scale: (n, 3) natural logarithm of the standard deviations in units of the triangle.
        quaternion: (n, 4) wxyz, of any length.
        binding: (n,) triangle of each.
        frames: of the posed head.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4.
    """
    rotation, scale, origin, turn = frames.table.index_select(0, binding).split_with_sizes([9, 1, 3, 4], 1)
    means = scale * (rotation.view(-1, 3, 3) * position[:, None, :]).sum(2) + origin
    aw, ax, ay, az = turn.unbind(1)
    w, x, y, z = normalize(quaternion, dim=1, eps=SMALLEST_NORM).unbind(1)
    turned = torch.stack(
        [
            aw * w - ax * x - ay * y - az * z,
            aw * x + ax * w + ay * z - az * y,
            aw * y - ax * z + ay * w + az * x,
            aw * z + ax * y - ay * x + az * w,
        ],
        1,
    )
    return means, scale * log_scale.exp(), turned
