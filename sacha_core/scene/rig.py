"""A head's controls as arrays: expressions, pose correctives, joints and weights, for one person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.model import JOINTS, HeadModel
from sacha_core.flame.posing import HeadMotion, fit_components, person_template

__all__ = ["Rig", "expression_names", "rig_of"]

LARGEST_VALUE = 10.0  # of a shape key in Blender; coefficients beyond it need keys that are longer
MOST_IDENTITY = 50  # components that are given as controls: the first, which say most; each costs every frame a little
NAMED_RANGE = (0.0, 1.0)  # of expressions that have names: those are shapes to be reached, not components


@dataclass(frozen=True)
class Rig:
    """The controls of one person's head; what they do together is what `flame.posing` says.

    Of a head that is nobody's yet, the first controls are its identity components, then come the expressions.

    A vertex before skinning is `vertices + sum_k value_k directions_k + sum_p (R - I)_p correctives_p`, where R is the rotation of a joint
    relative to its parent; a joint is `joints + sum_k value_k joint_directions_k`; then follow rotation about the joints, skinning, and the
    translation of the root. Axes y up, metres. An expression coefficient is its value times its scale.

    Args:
        names: of the identity components and the expressions.
        n_identity: how many of the first are identity.
        directions: (k, v, 3) float32, of a vertex for a value of 1.
        joint_directions: (k, j, 3) float64, of a joint for a value of 1.
        scales: (k,) what a value of 1 is as a coefficient; 1 but where the motion goes beyond what a shape key can hold.
        ranges: (k, 2) least and largest useful value.
        correctives: (p, v, 3) float32, those that move anything.
        corrective_entries: (p,) the entry of R - I that drives each: 9 (joint - 1) + 3 row + column.
        joint_names: from the root.
        parents: of each joint; -1 for the root.
        joints: (j, 3) where they lie while nothing moves.
        weights: (v, j) skinning weights.
        shape: (s,) identity coefficients of the person.
    """

    names: list[str]
    n_identity: int
    directions: Float[np.ndarray, "k v 3"]
    joint_directions: Float[np.ndarray, "k j 3"]
    scales: Float[np.ndarray, " k"]
    ranges: Float[np.ndarray, "k 2"]
    correctives: Float[np.ndarray, "p v 3"]
    corrective_entries: Int[np.ndarray, " p"]
    joint_names: list[str]
    parents: list[int]
    joints: Float[np.ndarray, "j 3"]
    weights: Float[np.ndarray, "v j"]
    shape: Float[np.ndarray, " s"]


def rig_of(head: HeadModel, person: HeadMotion, n_vertices: int | None = None, *, identity: bool = False) -> Rig:
    """Give the controls of a person's head.

    Args:
        head: the head model.
        person: whose shape and offsets make the person; its expressions tell how far values must reach.
        n_vertices: of the mesh that is shown, where it has only the head's first ones (teeth come last).
        identity: whether the person is still to be made: its identity components are controls too.

    Raises:
        HeadError: the person has components or vertex offsets that the head lacks.
    """
    n_identity = min(head.shapedirs.shape[2], MOST_IDENTITY) if identity else 0
    scales, ranges = _extents(head, person, n_identity)
    _, joints = person_template(head, person, np.float64)
    directions = np.concatenate([head.shapedirs[:, :, :n_identity], head.exprdirs], axis=2).astype(np.float64) * scales
    posedirs = np.zeros((head.n_vertices, 3, 0), np.float32) if head.posedirs is None else head.posedirs
    correctives = posedirs.transpose(2, 0, 1)
    entries = np.flatnonzero(correctives.any(axis=(1, 2))).astype(np.int32)
    return Rig(
        names=[*(f"identity_{k:03d}" for k in range(n_identity)), *expression_names(head)],
        n_identity=n_identity,
        directions=np.ascontiguousarray(directions.transpose(2, 0, 1)[:, :n_vertices], np.float32),
        joint_directions=np.einsum("jv,vck->kjc", head.J_regressor.astype(np.float64), directions),
        scales=scales,
        ranges=ranges,
        correctives=np.ascontiguousarray(correctives[entries, :n_vertices], np.float32),
        corrective_entries=entries,
        joint_names=list(JOINTS[: len(head.parents)]),
        parents=head.parents.tolist(),
        joints=joints,
        weights=np.ascontiguousarray(head.weights[:n_vertices], np.float32),
        shape=np.asarray(person.shape, np.float32),
    )


def _extents(
    head: HeadModel, person: HeadMotion, n_identity: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 2"]]:
    """Give the scales and the ranges of the controls, so that every value of a motion can be reached."""
    n_expressions = head.exprdirs.shape[2]
    used = fit_components(np.asarray(person.expression, np.float64), n_expressions, "expression", head)
    extent = np.zeros((2, n_identity + n_expressions))
    extent[:, n_identity : n_identity + used.shape[1]] = used.min(axis=0, initial=0), used.max(axis=0, initial=0)
    scales = np.maximum(1.0, np.abs(extent).max(axis=0) / LARGEST_VALUE)
    least, largest = np.full(extent.shape[1], -LARGEST_VALUE), np.full(extent.shape[1], LARGEST_VALUE)
    if head.expression_names:
        least[n_identity:], largest[n_identity:] = NAMED_RANGE
    ranges = np.stack([np.minimum(extent[0] / scales, least), np.maximum(extent[1] / scales, largest)], axis=1)
    return scales, ranges.astype(np.float32)


def expression_names(head: HeadModel) -> list[str]:
    """Give a name for each expression: the head's own, or numbers from 0 as its makers count."""
    return list(head.expression_names) or [f"expression_{k:03d}" for k in range(head.exprdirs.shape[2])]
