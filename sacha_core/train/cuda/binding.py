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

__all__ = ["Binder", "Frames"]

# Entries of 4 q q^T - 1 for a unit quaternion wxyz, row by row, as sums of the rotation's entries
OUTER = (
    "+xx+yy+zz", "+zy-yz", "+xz-zx", "+yx-xy",
    "+zy-yz", "+xx-yy-zz", "+xy+yx", "+xz+zx",
    "+xz-zx", "+xy+yx", "+yy-xx-zz", "+yz+zy",
    "+yx-xy", "+xz+zx", "+yz+zy", "+zz-xx-yy",
)  # fmt: skip
# The matrix that multiplies by a quaternion from the left, row by row
PRODUCT = ("+w", "-x", "-y", "-z", "+x", "+w", "-z", "+y", "+y", "+z", "+w", "-x", "+z", "-y", "+x", "+w")


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


class Binder:
    """Finds the frames of a mesh's triangles, and carries Gaussians along.

    Args:
        faces: (f, 3) vertex indices, counter-clockwise seen from outside.
        device: where to compute.
        dtype: float32, or float64 where gradients are checked.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
    """

    def __init__(self, faces: Int[np.ndarray, "f 3"], device: torch.device, dtype: torch.dtype = torch.float32) -> None:
        self._corners = torch.from_numpy(faces.astype(np.int32)).to(device).reshape(-1)
        self._outer = signs(OUTER, [a + b for a in "xyz" for b in "xyz"]).to(device, dtype)
        self._one = torch.eye(4, device=device, dtype=dtype).reshape(-1)
        self._product = signs(PRODUCT, list("wxyz")).to(device, dtype)
        numbers = torch.finfo(dtype)
        self._limit, self._smallest = degenerate_limit(np.dtype(numbers.dtype)) ** 2, float(numbers.tiny)

    def frames(self, vertices: Float[Tensor, "v 3"]) -> Frames:
        """Find the frames: see `sacha_core.geometry.triangle`. A degenerate triangle is told, not refused: nothing waits for the device.

        Args:
            vertices: (v, 3) posed, metres.
        """
        p0, p1, p2 = vertices.index_select(0, self._corners).view(-1, 3, 3).unbind(1)
        edge, second = p1 - p0, p2 - p0
        normal = torch.linalg.cross(edge, second)
        edge_squared, normal_squared = (edge * edge).sum(1), (normal * normal).sum(1)
        sound = (normal_squared > self._limit * edge_squared * (second * second).sum(1)) & (normal_squared < torch.inf)
        sound &= torch.minimum(normal_squared, edge_squared) >= self._smallest
        edge_length, normal_length = edge_squared.sqrt(), normal_squared.sqrt()
        scale = (edge_length + normal_length / edge_length) / 2
        edge, normal = edge / edge_length[:, None], normal / normal_length[:, None]
        rotation = torch.stack([edge, normal, torch.linalg.cross(edge, normal)], 2).view(-1, 9)
        return Frames(torch.cat([rotation, scale[:, None], (p0 + p1 + p2) / 3, self._quaternions(rotation)], 1), sound)

    def carry(
        self,
        position: Float[Tensor, "n 3"],
        log_scale: Float[Tensor, "n 3"],
        quaternion: Float[Tensor, "n 4"],
        binding: Int[Tensor, " n"],
        frames: Frames,
    ) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"], Float[Tensor, "n 4"]]:
        """Carry Gaussians; give means and standard deviations, metres, and unit quaternions in the world.

        Args:
            position: (n, 3) in units of the triangle.
            log_scale: (n, 3) natural logarithm of the standard deviations in units of the triangle.
            quaternion: (n, 4) wxyz, of any length.
            binding: (n,) triangle of each.
            frames: of the posed head.
        """
        rotation, scale, origin, turn = frames.table.index_select(0, binding).split_with_sizes([9, 1, 3, 4], 1)
        means = scale * (rotation.view(-1, 3, 3) * position[:, None, :]).sum(2) + origin
        unit = normalize(quaternion, dim=1, eps=SMALLEST_NORM)
        turned = ((turn @ self._product).view(-1, 4, 4) * unit[:, None, :]).sum(2)
        return means, scale * log_scale.exp(), turned

    def _quaternions(self, rotation: Float[Tensor, "f 9"]) -> Float[Tensor, "f 4"]:
        """Give the unit quaternion of each matrix, its largest component positive: see `sacha_core.geometry.quaternion.from_matrix`.

        Source: Shepperd, Quaternion from rotation matrix, 1978.
        """
        outer = torch.addmm(self._one, rotation, self._outer)
        largest = outer[:, ::5].argmax(1)
        rows = outer.view(-1, 4, 4).gather(1, largest[:, None, None].expand(-1, 1, 4))
        return normalize(rows[:, 0], dim=1, eps=SMALLEST_NORM)


def signs(sums: tuple[str, ...], terms: list[str]) -> Float[Tensor, "k m"]:
    """Give the matrix whose columns are sums of terms, each written with its sign."""
    table, width = torch.zeros(len(terms), len(sums)), 1 + len(terms[0])
    for column, text in enumerate(sums):
        for at in range(0, len(text), width):
            table[terms.index(text[at + 1 : at + width]), column] = 1 if text[at] == "+" else -1
    return table
