"""Posing on a device, differentiable by torch: the twin of `sacha_core.flame.posing`."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion, Poser
from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, SMALLEST_ANGLE_RAD

__all__ = ["DeviceHead"]


class DeviceHead:
    """One person's head on a device.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        device: where to compute.
        dtype: float32, or float64 where gradients are checked.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5.
    """

    def __init__(
        self, head: HeadModel, motion: HeadMotion, device: torch.device, dtype: torch.dtype = torch.float32
    ) -> None:
        poser = Poser(head, motion)
        arrays = (poser.template, poser.joints, poser.directions, poser.joint_directions, poser.weights)
        tensors = [torch.from_numpy(array).to(device, dtype) for array in arrays]
        self._template, self._joints, self._directions, self._joint_directions, self._weights = tensors
        self._parents = [int(parent) for parent in poser.parents]
        self._has_correctives = poser.has_correctives
        self._identity = torch.eye(3, device=device, dtype=dtype)

    def pose(
        self, expression: Float[Tensor, " e"], pose: Float[Tensor, "15"], translation: Float[Tensor, "3"]
    ) -> Float[Tensor, "v 3"]:
        """Give the posed vertices, metres.

        Args:
            expression: coefficients; those for which the motion or the head has no directions are ignored.
            pose: axis-angle vectors of root, neck, jaw, left and right eye, radians; those of joints that the head lacks are ignored.
            translation: of the posed head, metres.
        """
        expression = expression[: self._joint_directions.shape[2]]
        rotations = rotation_matrices(pose.view(5, 3)[: len(self._parents)])
        coefficients = expression
        if self._has_correctives:
            coefficients = torch.cat([expression, (rotations[1:] - self._identity).reshape(-1)])
        unposed = self._template + (coefficients @ self._directions).view(-1, 3)
        transforms = self._transforms(rotations, self._joints + self._joint_directions @ expression)
        blended = (self._weights @ transforms.reshape(-1, 12)).view(-1, 3, 4)
        return (blended[:, :, :3] * unposed[:, None, :]).sum(2) + (blended[:, :, 3] + translation)

    def _transforms(self, rotations: Float[Tensor, "j 3 3"], joints: Float[Tensor, "j 3"]) -> Float[Tensor, "j 3 4"]:
        """Give each joint's map from the unposed to the posed head: see `sacha_core.geometry.skinning.joint_transforms`."""
        maps: list[tuple[Tensor, Tensor]] = []
        for rotation, joint, parent in zip(rotations, joints, self._parents, strict=True):
            if parent < 0:
                turned, place = rotation, joint
            else:
                above, offset = maps[parent]
                turned, place = above @ rotation, above @ joint + offset
            maps.append((turned, place - turned @ joint))
        return torch.cat([torch.stack([r for r, _ in maps]), torch.stack([t for _, t in maps])[:, :, None]], 2)


def rotation_matrices(vectors: Float[Tensor, "j 3"]) -> Float[Tensor, "j 3 3"]:
    """Give the matrix of each rotation vector: see `sacha_core.geometry.rotation.rotation_vectors_to_matrices`."""
    angle = (vectors + ANGLE_OFFSET_RAD).norm(dim=1).clamp_min(SMALLEST_ANGLE_RAD)
    first = angle.sin() / angle
    second = 2 * ((angle / 2).sin() / angle) ** 2
    x, y, z = vectors.unbind(1)
    sx, sy, sz = second * x, second * y, second * z
    entries = (
        1 - sy * y - sz * z, sx * y - first * z, sx * z + first * y,
        sx * y + first * z, 1 - sx * x - sz * z, sy * z - first * x,
        sx * z - first * y, sy * z + first * x, 1 - sx * x - sy * y,
    )  # fmt: skip
    return torch.stack(entries, 1).view(-1, 3, 3)
