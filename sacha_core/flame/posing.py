"""Posing a head: identity, expression, pose correctives, joints and skinning."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.geometry.contraction import contract
from sacha_core.geometry.rotation import rotation_vectors_to_matrices
from sacha_core.geometry.skinning import joint_transforms, skin

__all__ = [
    "TURNS",
    "HeadMotion",
    "Poser",
    "fit_components",
    "joint_vectors",
    "person_template",
    "pose_many",
    "pose_vertices",
]

TURNS = ("rotation", "neck", "jaw", "eyes")  # axis-angle vectors of the joints, in this order


@runtime_checkable
class HeadMotion(Protocol):
    """What posing needs of a motion; `sacha_core.avatar.motion.Motion`, which see, is one."""

    @property
    def shape(self) -> Float[np.ndarray, " s"]:
        """Identity coefficients."""

    @property
    def static_offset(self) -> Float[np.ndarray, "v 3"]:
        """Personal vertex offsets, metres; no rows where there are none."""

    @property
    def expression(self) -> Float[np.ndarray, "t e"]:
        """Expression coefficients."""

    @property
    def rotation(self) -> Float[np.ndarray, "t 3"]:
        """Of the root joint, axis-angle, radians."""

    @property
    def neck(self) -> Float[np.ndarray, "t 3"]:
        """Of the neck joint."""

    @property
    def jaw(self) -> Float[np.ndarray, "t 3"]:
        """Of the jaw joint."""

    @property
    def eyes(self) -> Float[np.ndarray, "t 6"]:
        """Of the eyeballs, left and then right."""

    @property
    def translation(self) -> Float[np.ndarray, "t 3"]:
        """Of the posed head, metres."""


class Poser:
    """One person's head, ready to be posed: what does not change from frame to frame is computed once.

    Sums run in a fixed order on one thread, so a frame has the same bits however it is asked for.

    Args:
        head: the head model.
        motion: whose static parameters make the person, and whose frames are posed.
        dtype: float32, or float64 where it serves as a reference.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.

    Source: Li et al., FLAME, SIGGRAPH Asia 2017, equations 2 to 5.
    """

    def __init__(self, head: HeadModel, motion: HeadMotion, dtype: type[np.floating] = np.float32) -> None:
        self.motion = motion
        self.parents = head.parents
        self.weights = np.ascontiguousarray(head.weights, dtype)
        self.template, self.joints = person_template(head, motion, dtype)
        regressor = np.asarray(head.J_regressor, dtype)
        expressions = fit_components(np.asarray(motion.expression, dtype), head.exprdirs.shape[2], "expression", head)
        self.expressions = np.ascontiguousarray(expressions)
        used = head.exprdirs[:, :, : expressions.shape[1]].astype(dtype, copy=False)
        self.joint_directions = np.einsum("jv,vce->jce", regressor, used)
        correctives = [] if head.posedirs is None else [head.posedirs.astype(dtype, copy=False)]
        self.directions = np.ascontiguousarray(
            np.concatenate([used, *correctives], axis=2).reshape(3 * head.n_vertices, -1).T
        )
        self.has_correctives = head.posedirs is not None

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.expressions)

    def __call__(self, frame: int) -> Float[np.ndarray, "v 3"]:
        """Give the posed vertices of one frame, metres.

        Raises:
            IndexError: the motion has no such frame.
        """
        dtype = self.template.dtype
        expression = self.expressions[frame]
        rotations = rotation_vectors_to_matrices(
            joint_vectors(self.motion, frame).astype(dtype, copy=False)[: len(self.parents)]
        )
        unposed, joints = self.unposed(expression, rotations)
        posed = skin(unposed, self.weights, joint_transforms(rotations, joints, self.parents))
        posed += self.motion.translation[frame].astype(dtype, copy=False)
        return posed

    def unposed(
        self, expression: Float[np.ndarray, " e"], rotations: Float[np.ndarray, "j 3 3"]
    ) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "j 3"]]:
        """Give vertices and joints before skinning, metres: the person with an expression, corrected for the pose to come."""
        coefficients = expression
        if self.has_correctives:
            correctives = rotations[1:] - np.eye(3, dtype=rotations.dtype)
            coefficients = np.concatenate([expression, correctives.reshape(-1)])
        vertices = self.template + contract("k,kx->x", coefficients, self.directions).reshape(-1, 3)
        return vertices, self.joints + contract("jce,e->jc", self.joint_directions, expression)


def joint_vectors(motion: HeadMotion, frame: int) -> Float[np.ndarray, "5 3"]:
    """Give the axis-angle vectors of root, neck, jaw, left and right eye in one frame, radians.

    Raises:
        IndexError: the motion has no such frame.
    """
    return np.concatenate([getattr(motion, name)[frame] for name in TURNS]).reshape(5, 3)


def pose_vertices(head: HeadModel, motion: HeadMotion, frame: int) -> Float[np.ndarray, "v 3"]:
    """Give the posed vertices of one frame, metres, float32; `Poser` is quicker for several frames of one motion.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
        IndexError: the motion has no such frame.
    """
    return Poser(head, motion)(frame)


def pose_many(head: HeadModel, motion: HeadMotion) -> Float[np.ndarray, "t v 3"]:
    """Give the posed vertices of every frame, metres, float32: the same bits as frame by frame.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks.
    """
    poser = Poser(head, motion)
    posed = np.empty((len(poser), head.n_vertices, 3), np.float32)
    for frame in range(len(poser)):
        posed[frame] = poser(frame)
    return posed


def person_template(
    head: HeadModel, motion: HeadMotion, dtype: type[np.floating] = np.float32
) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "j 3"]]:
    """Give a person's unposed neutral vertices and joints, metres.

    Joints are regressed after the personal offsets are added.

    Raises:
        HeadError: the motion has identity components or vertex offsets that the head lacks.
    """
    shape = fit_components(np.asarray(motion.shape, dtype)[None], head.shapedirs.shape[2], "shape", head)[0]
    template = head.v_template.astype(dtype)
    template += contract("vcs,s->vc", head.shapedirs[:, :, : len(shape)], shape)
    if len(motion.static_offset):
        if motion.static_offset.shape != template.shape:
            raise HeadError(
                f"static_offset has {len(motion.static_offset)} rows, but head {head.name!r} has {head.n_vertices} vertices"
            )
        template += motion.static_offset
    return template, np.einsum("jv,vc->jc", np.asarray(head.J_regressor, dtype), template)


def fit_components(
    coefficients: Float[np.ndarray, "t k"], n_available: int, parameter: str, head: HeadModel
) -> Float[np.ndarray, "t m"]:
    """Give the coefficients for which a head has directions; those beyond must be zero.

    Raises:
        HeadError: a coefficient without a direction is not zero, so leaving it out would change the face.
    """
    beyond = np.abs(coefficients[:, n_available:])
    if beyond.any():
        frame, component = np.argwhere(beyond)[0]
        raise HeadError(
            f"head {head.name!r} has {n_available} {parameter} components, but component {n_available + component}"
            f" is {coefficients[frame, n_available + component]:.6g} at row {frame}"
        )
    return coefficients[:, :n_available]
