"""Posing on a device, differentiable by torch: the twin of `sacha_core.flame.posing`.

On so few numbers a kernel takes longer to launch than to run, so that few operations are better than little arithmetic.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion, Poser
from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, SMALLEST_ANGLE_RAD

__all__ = ["DeviceHead"]

N_JOINTS = 5
# v @ CROSS is the cross-product matrix of v, row by row
CROSS = ((0, 0, 0, 0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 0, 0, -1, 0, 0), (0, -1, 0, 1, 0, 0, 0, 0, 0))


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
        self._has_correctives = poser.has_correctives
        self._levels, self._order = levels([int(parent) for parent in poser.parents], device)
        self._cross = torch.tensor(CROSS, device=device, dtype=dtype)
        self._identity = torch.eye(3, device=device, dtype=dtype)
        self._last_row = torch.tensor([0, 0, 0, 1], device=device, dtype=dtype).expand(len(poser.parents), 1, 4)

    def pose(self, row: Float[Tensor, " w"]) -> Float[Tensor, "v 3"]:
        """Give the posed vertices, metres.

        Args:
            row: motion parameters in the order of `FITTED_MOTION`: axis-angle vectors of root, neck, jaw, left and right eye, radians;
                translation, metres; expression coefficients. Joints that the head lacks and coefficients without a direction are ignored.
        """
        vectors, translation, expression = row.split_with_sizes([3 * N_JOINTS, 3, len(row) - 3 * N_JOINTS - 3])
        expression = expression[: self._joint_directions.shape[2]]
        rotations = self._rotations(vectors.view(N_JOINTS, 3)[: len(self._joints)])
        coefficients = expression
        if self._has_correctives:
            coefficients = torch.cat([expression, (rotations[1:] - self._identity).reshape(-1)])
        unposed = self._template + (coefficients @ self._directions).view(-1, 3)
        transforms = self._transforms(rotations, self._joints + self._joint_directions @ expression)
        blended = (self._weights @ transforms.reshape(-1, 12)).view(-1, 3, 4)
        return (blended[:, :, :3] * unposed[:, None, :]).sum(2) + (blended[:, :, 3] + translation)

    def _rotations(self, vectors: Float[Tensor, "j 3"]) -> Float[Tensor, "j 3 3"]:
        """Give the matrix of each rotation vector: see `sacha_core.geometry.rotation.rotation_vectors_to_matrices`."""
        angle = (vectors + ANGLE_OFFSET_RAD).norm(dim=1).clamp_min(SMALLEST_ANGLE_RAD)[:, None, None]
        first, half = angle.sin() / angle, (angle / 2).sin() / angle
        cross = (vectors @ self._cross).view(-1, 3, 3)
        matrices: Tensor = self._identity + first * cross + 2 * half * half * (cross @ cross)
        return matrices

    def _transforms(self, rotations: Float[Tensor, "j 3 3"], joints: Float[Tensor, "j 3"]) -> Float[Tensor, "j 3 4"]:
        """Give each joint's map from the unposed to the posed head: see `sacha_core.geometry.skinning.joint_transforms`.

        A joint turns about its own place, x to R x + (J - R J), and then goes where its parent's map takes it.
        """
        places = joints[:, :, None]
        own = torch.cat([torch.cat([rotations, places - rotations @ places], 2), self._last_row], 1)
        done: list[Tensor] = []
        for members, parents in self._levels:
            maps = own.index_select(0, members)
            done.append(maps if parents is None else torch.cat(done).index_select(0, parents) @ maps)
        return torch.cat(done).index_select(0, self._order)[:, :3]


def levels(
    parents: list[int], device: torch.device
) -> tuple[list[tuple[Int[Tensor, " m"], Int[Tensor, " m"] | None]], Int[Tensor, " j"]]:
    """Sort joints by their distance from the root.

    Args:
        parents: of each joint, which come before it; -1 for a root.
        device: where the indices are wanted.

    Returns:
        Of each distance the joints, and the places of their parents among the joints of smaller distances, by distance; and the places of
        all joints in that order.
    """
    depth: list[int] = []
    for parent in parents:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    order = sorted(range(len(parents)), key=lambda joint: (depth[joint], joint))
    place = {joint: i for i, joint in enumerate(order)}
    found: list[tuple[Tensor, Tensor | None]] = []
    for level in range(max(depth) + 1):
        members = [joint for joint in order if depth[joint] == level]
        above = None if level == 0 else torch.tensor([place[parents[joint]] for joint in members], device=device)
        found.append((torch.tensor(members, device=device), above))
    return found, torch.tensor([place[joint] for joint in range(len(parents))], device=device)
