"""Triangle frames and bound Gaussians that gradients can flow through: the twin of `sacha_core.avatar.binding`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from sacha_core.geometry.triangle import triangle_frames as numpy_frames
from sacha_core.train.kernels import binding as kernels

__all__ = ["Frames", "WorldTensors", "to_world", "triangle_frames"]


@dataclass(frozen=True)
class Frames:
    """Frames of f triangles, as in `sacha_core.geometry.triangle`, with their quaternions.

    Args:
        rotation: (f, 3, 3) columns: first edge, normal, and their cross product.
        scale: (f,) metres.
        origin: (f, 3) centroid, metres.
        quaternion: (f, 4) wxyz of `rotation`, largest component positive.
    """

    rotation: Float[Tensor, "f 3 3"]
    scale: Float[Tensor, " f"]
    origin: Float[Tensor, "f 3"]
    quaternion: Float[Tensor, "f 4"]


@dataclass(frozen=True)
class WorldTensors:
    """n Gaussians in the world.

    Args:
        means: (n, 3) metres.
        scales: (n, 3) standard deviations, metres.
        quaternions: (n, 4) wxyz, unit length.
    """

    means: Float[Tensor, "n 3"]
    scales: Float[Tensor, "n 3"]
    quaternions: Float[Tensor, "n 4"]


def triangle_frames(vertices: Float[Tensor, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Frames:
    """Frame of each triangle, differentiable by the vertices.

    Raises:
        GeometryError: a face has zero area or a vertex that is not finite; the message names the first such face.

    Source: Qian et al., GaussianAvatars, CVPR 2024, section 3.2; gradients own.
    """
    return Frames(*_TriangleFrames.apply(vertices, faces))  # type: ignore[no-untyped-call]


def to_world(
    position: Float[Tensor, "n 3"],
    log_scale: Float[Tensor, "n 3"],
    quaternion: Float[Tensor, "n 4"],
    binding: Int[np.ndarray, " n"],
    frames: Frames,
) -> WorldTensors:
    """Carry Gaussians along with their triangles, differentiable by their raw parameters and by the frames.

    Args:
        position: (n, 3) in units of the triangle.
        log_scale: (n, 3) natural logarithm of the standard deviations in units of the triangle.
        quaternion: (n, 4) wxyz, of any length.
        binding: (n,) triangle of each; not checked here, since it runs at every iteration.
        frames: of the posed head; where it needs no gradient, none is computed for it.

    Source: Qian et al., GaussianAvatars, CVPR 2024, equations 2 to 4; gradients own.
    """
    return WorldTensors(
        *_ToWorld.apply(  # type: ignore[no-untyped-call]
            position, log_scale, quaternion, binding, frames.rotation, frames.scale, frames.origin, frames.quaternion
        )
    )


class _TriangleFrames(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, vertices: Tensor, faces: np.ndarray) -> tuple[Tensor, ...]:
        points = np.ascontiguousarray(vertices.detach().numpy())
        frames = numpy_frames(points, faces)
        quaternion = np.empty((len(faces), 4), points.dtype)
        kernels.quaternions(frames.rotation, quaternion)
        ctx.inputs = points, faces, frames.rotation, quaternion
        return tuple(torch.from_numpy(a) for a in (frames.rotation, frames.scale, frames.origin, quaternion))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        points, faces, rotation, quaternion = ctx.inputs
        out = np.zeros_like(points)
        kernels.frames_backward(points, faces, rotation, quaternion, *(g.contiguous().numpy() for g in gradients), out)
        return torch.from_numpy(out), None


class _ToWorld(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *tensors: Any) -> tuple[Tensor, ...]:
        position, log_scale, quaternion, binding, *frames = (
            t if isinstance(t, np.ndarray) else np.ascontiguousarray(t.detach().numpy()) for t in tensors
        )
        scale = np.exp(log_scale)
        outputs = np.empty_like(position), np.empty_like(scale), np.empty_like(quaternion)
        kernels.to_world(position, scale, quaternion, binding, *frames, *outputs)
        rotation, frame_scale, _, frame_quaternion = frames
        ctx.inputs = position, scale, quaternion, binding, rotation, frame_scale, frame_quaternion
        return tuple(torch.from_numpy(a) for a in outputs)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        position, scale, quaternion, _, rotation, frame_scale, frame_quaternion = ctx.inputs
        with_frames = any(ctx.needs_input_grad[4:])
        own = np.empty_like(position), np.empty_like(scale), np.empty_like(quaternion)
        of_frames = [np.zeros_like(a) for a in (rotation, frame_scale, rotation[:, :, 0], frame_quaternion)]
        kernels.to_world_backward(
            *ctx.inputs, *(g.contiguous().numpy() for g in gradients), with_frames, *own, *of_frames
        )
        back = [torch.from_numpy(a) for a in of_frames] if with_frames else [None] * 4
        return (*(torch.from_numpy(a) for a in own), None, *back)
