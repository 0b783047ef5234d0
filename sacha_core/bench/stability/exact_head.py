"""The head of a person as FLAME's and GaussianAvatars' equations have it, in float64 and differentiable by a timestep's parameters."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.bench.exact import Leaves
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion

__all__ = ["ExactHead", "rotation_of"]

ANGLE_OFFSET_RAD = 1e-8  # FLAME adds it to each component of a rotation vector before it takes the angle


class ExactHead:
    """One person's head, written from the equations.

    Args:
        head: the head model.
        motion: whose static parameters make the person.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5; Qian et al., GaussianAvatars, CVPR 2024, section 3.2.
    """

    def __init__(self, head: HeadModel, motion: HeadMotion) -> None:
        self._parents = head.parents.tolist()
        self._faces = torch.from_numpy(head.faces.astype(np.int64))
        self._regressor, self._weights, expressions = (
            torch.from_numpy(a.astype(np.float64)) for a in (head.J_regressor, head.weights, head.exprdirs)
        )
        self._correctives = None if head.posedirs is None else torch.from_numpy(head.posedirs.astype(np.float64))
        used = min(motion.expression.shape[1], expressions.shape[2])
        self._expressions = expressions[:, :, :used]
        n_shape = min(len(motion.shape), head.shapedirs.shape[2])
        person = head.v_template.astype(np.float64)
        person += head.shapedirs[:, :, :n_shape].astype(np.float64) @ motion.shape[:n_shape].astype(np.float64)
        if len(motion.static_offset):
            person += motion.static_offset
        self._person = torch.from_numpy(person)

    def vertices(self, leaves: Leaves) -> Float[Tensor, "v 3"]:
        """Give the posed vertices, metres.

        Args:
            leaves: `expression`, `rotation`, `neck`, `jaw`, `eyes`, `translation` of one timestep.
        """
        shaped = self._person + self._expressions @ leaves["expression"][: self._expressions.shape[2]]
        joints = self._regressor @ shaped
        vectors = torch.cat([leaves[name] for name in ("rotation", "neck", "jaw", "eyes")]).reshape(-1, 3)
        rotations = [rotation_of(vector) for vector in vectors[: len(self._parents)]]
        if self._correctives is not None and len(rotations) > 1:
            identity = torch.eye(3, dtype=torch.float64)
            feature = torch.cat([(rotation - identity).reshape(-1) for rotation in rotations[1:]])
            shaped = shaped + self._correctives @ feature
        turns: list[Tensor] = []
        places: list[Tensor] = []
        for joint, (rotation, parent) in enumerate(zip(rotations, self._parents, strict=True)):
            if parent < 0:
                turns.append(rotation)
                places.append(joints[joint])
            else:
                turns.append(turns[parent] @ rotation)
                places.append(places[parent] + turns[parent] @ (joints[joint] - joints[parent]))
        moved = [(shaped - joints[j]) @ turns[j].T + places[j] for j in range(len(turns))]
        return torch.einsum("vj,jvc->vc", self._weights, torch.stack(moved)) + leaves["translation"]

    def frames(
        self, vertices: Float[Tensor, "v 3"]
    ) -> tuple[Float[Tensor, "f 3 3"], Float[Tensor, " f"], Float[Tensor, "f 3"]]:
        """Give rotation, scale and origin of each triangle's frame."""
        a, b, c = (vertices[self._faces[:, corner]] for corner in range(3))
        first = torch.nn.functional.normalize(b - a, dim=1)
        normal = torch.nn.functional.normalize(torch.linalg.cross(first, c - a), dim=1)
        third = torch.linalg.cross(first, normal)
        height = (third * (c - a)).sum(1).abs()
        scale = ((b - a).norm(dim=1) + height) / 2
        return torch.stack([first, normal, third], 2), scale, (a + b + c) / 3


def rotation_of(vector: Float[Tensor, "3"]) -> Float[Tensor, "3 3"]:
    """Give the matrix of a rotation vector by Rodrigues' formula, with the angle that FLAME uses."""
    angle = (vector + ANGLE_OFFSET_RAD).norm()
    x, y, z = vector.unbind()
    zero = torch.zeros_like(x)
    cross = torch.stack([torch.stack([zero, -z, y]), torch.stack([z, zero, -x]), torch.stack([-y, x, zero])])
    half = torch.sin(angle / 2) / angle
    rotation: Tensor = (
        torch.eye(3, dtype=torch.float64) + torch.sin(angle) / angle * cross + 2 * half * half * cross @ cross
    )
    return rotation
