"""Posing that gradients can flow through: the twin of `sacha_core.flame.posing`, for fine-tuning one frame's parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import HeadMotion, Poser
from sacha_core.geometry.rotation import ANGLE_OFFSET_RAD, rotation_vectors_to_matrices
from sacha_core.geometry.skinning import joint_transforms
from sacha_core.train.kernels import posing as kernels

__all__ = ["DifferentiablePoser"]

N_POSE = 15  # root, neck, jaw, left eye, right eye


class DifferentiablePoser:
    """One person's head, posed from tensors.

    Identity and personal offsets are constants, as in GaussianAvatars' fine-tuning. Runs on the CPU, on one thread.

    Args:
        head: the head model.
        motion: whose static parameters make the person.
        dtype: of the parameters; float64 for checking gradients.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5; gradients own.
    """

    def __init__(self, head: HeadModel, motion: HeadMotion, dtype: type[np.floating] = np.float32) -> None:
        self.poser = Poser(head, motion, dtype)

    def __call__(
        self,
        expression: Float[Tensor, " e"],
        rotation: Float[Tensor, "3"],
        neck: Float[Tensor, "3"],
        jaw: Float[Tensor, "3"],
        eyes: Float[Tensor, "6"],
        translation: Float[Tensor, "3"],
    ) -> Float[Tensor, "v 3"]:
        """Give the posed vertices, metres.

        Args:
            expression: coefficients, as many as the motion has and the head has directions for at most; the rest are ignored.
            rotation: of the root, axis-angle, radians; so are the next three.
            neck: of the neck.
            jaw: of the jaw.
            eyes: of the eyeballs, left and then right.
            translation: of the posed head, metres.
        """
        pose = torch.cat([rotation, neck, jaw, eyes])
        n_expression = self.poser.joint_directions.shape[2]
        posed: Tensor = _Pose.apply(self.poser, expression[:n_expression], pose, translation)  # type: ignore[no-untyped-call]
        return posed


class _Pose(torch.autograd.Function):
    """Expression, pose (15,) and translation to posed vertices."""

    @staticmethod
    def forward(ctx: Any, poser: Poser, expression: Tensor, pose: Tensor, translation: Tensor) -> Tensor:
        psi = np.ascontiguousarray(expression.detach().numpy())
        vectors = pose.detach().numpy().reshape(5, 3)[: len(poser.parents)]
        rotations = rotation_vectors_to_matrices(vectors)
        unposed, joints = poser.unposed(psi, rotations)
        transforms = joint_transforms(rotations, joints, poser.parents)
        posed = np.empty_like(unposed)
        kernels.skin(unposed, poser.weights, transforms, translation.detach().numpy(), posed)
        ctx.poser, ctx.vectors, ctx.rotations, ctx.joints = poser, vectors, rotations, joints
        ctx.transforms, ctx.unposed = transforms, unposed
        return torch.from_numpy(posed)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        poser: Poser = ctx.poser
        dtype, n_joints = poser.template.dtype, len(poser.parents)
        n_expression = poser.joint_directions.shape[2]
        unposed_gradient = np.empty_like(poser.template)
        transform_gradient, translation_gradient = np.zeros((n_joints, 3, 4)), np.zeros(3)
        kernels.skin_backward(
            gradient.contiguous().numpy(), ctx.unposed, poser.weights, ctx.transforms,
            unposed_gradient, transform_gradient, translation_gradient,
        )  # fmt: skip
        coefficient_gradient = np.einsum("kx,x->k", poser.directions, unposed_gradient.reshape(-1))
        rotation_gradient, joint_gradient = np.zeros((n_joints, 3, 3)), np.zeros((n_joints, 3))
        if poser.has_correctives:
            rotation_gradient[1:] = coefficient_gradient[n_expression:].reshape(-1, 3, 3)
        kernels.joints_backward(
            ctx.rotations,
            ctx.joints,
            poser.parents,
            ctx.transforms,
            transform_gradient,
            rotation_gradient,
            joint_gradient,
        )
        pose_gradient = np.zeros((N_POSE // 3, 3))
        kernels.rodrigues_backward(ctx.vectors, rotation_gradient, ANGLE_OFFSET_RAD, pose_gradient)
        expression_gradient = coefficient_gradient[:n_expression] + np.einsum(
            "jce,jc->e", poser.joint_directions, joint_gradient
        )
        return (
            None,
            *(
                torch.from_numpy(g.reshape(-1).astype(dtype, copy=False))
                for g in (expression_gradient, pose_gradient, translation_gradient)
            ),
        )
