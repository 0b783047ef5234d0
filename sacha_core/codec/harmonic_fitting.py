"""Fitting the weights by which sizes of harmonics' levels are estimated: the encoder's business.

Source: own; least squares, each level by the inverse of the size expected of it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.harmonic_contexts import FEATURES, GROUPS, ONE, ActivityPlan, scale_of
from sacha_core.codec.order import FULL_TRUST, MATES, Layout
from sacha_core.codec.steps import PER_OCTAVE, Classes, StepRule

__all__ = ["fit_activity"]

ROUNDS = 3
LEAST = 1 / 256  # of a level: no estimate is less
WEIGHT_ONE, MAX_WEIGHT, MAX_FLOOR = 256, 255, 127


def fit_activity(layout: Layout, levels: Int[np.ndarray, "n c"], rule: StepRule, classes: Classes) -> ActivityPlan:
    """Give the plan by which sizes of these levels are estimated best."""
    n_components = levels.shape[1]
    group = np.zeros(len(levels), np.int64)
    for step in layout.passes:
        group[step.rows] = int(step.kind == MATES)
    size = np.abs(levels).astype(np.float64)
    features = features_of(layout, size, scale_of(rule, classes).astype(np.float64))
    weights, floors = np.zeros((GROUPS, FEATURES)), size.mean(axis=0) if len(size) else np.zeros(n_components)
    for _ in range(ROUNDS):
        expected = np.maximum(np.einsum("ncw,nw->nc", features, weights[group]) + floors, LEAST)
        solution = solve_positive(*normal_equations(features, size, group, 1 / expected))
        weights, floors = solution[: GROUPS * FEATURES].reshape(GROUPS, FEATURES), solution[GROUPS * FEATURES :]
    sent = np.minimum(np.rint(weights * WEIGHT_ONE), MAX_WEIGHT).astype(np.int64)
    exponents = np.rint(PER_OCTAVE * np.log2(np.maximum(floors * ONE, 1)))
    return ActivityPlan(sent, np.minimum(exponents, MAX_FLOOR).astype(np.int64))


def features_of(
    layout: Layout, size: Float[np.ndarray, "n c"], scale: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n c w"]:
    """What estimates are made of, in levels of each Gaussian's own step."""
    features = np.zeros((*size.shape, FEATURES))
    wide = size * scale[:, None]
    for step in layout.passes:
        for feature, rows, trust in ((0, step.near, step.trust), (1, step.mates, step.mate_trust)):
            if trust.any():
                around = (wide[rows] * trust[:, :, None]).sum(axis=1) / FULL_TRUST
                features[step.rows, :, feature] = around / scale[step.rows, None]
    return features


def normal_equations(
    features: Float[np.ndarray, "n c w"],
    size: Float[np.ndarray, "n c"],
    group: Int[np.ndarray, " n"],
    trust: Float[np.ndarray, "n c"],
) -> tuple[Float[np.ndarray, "u u"], Float[np.ndarray, " u"]]:
    """Sums for the weights of each group, then the floors."""
    n_weights, n_components = GROUPS * FEATURES, size.shape[1]
    matrix, right = np.zeros((n_weights + n_components,) * 2), np.zeros(n_weights + n_components)
    for g in range(GROUPS):
        mine = group == g
        part, heavy = features[mine], features[mine] * trust[mine][:, :, None]
        at = slice(g * FEATURES, (g + 1) * FEATURES)
        matrix[at, at] = np.einsum("ncw,ncv->wv", heavy, part)
        matrix[at, n_weights:] = heavy.sum(axis=0).T
        right[at] = np.einsum("ncw,nc->w", heavy, size[mine])
    matrix[n_weights:, :n_weights] = matrix[:n_weights, n_weights:].T
    matrix[n_weights:, n_weights:] = np.diag(trust.sum(axis=0))
    right[n_weights:] = (trust * size).sum(axis=0)
    return matrix, right


def solve_positive(matrix: Float[np.ndarray, "u u"], right: Float[np.ndarray, " u"]) -> Float[np.ndarray, " u"]:
    """Solve with unknowns that would be negative left out, one after the other."""
    alive = np.diag(matrix) > 0
    while True:
        solution = np.zeros(len(right))
        index = np.flatnonzero(alive)
        solution[index] = np.linalg.pinv(matrix[np.ix_(index, index)], rcond=1e-10, hermitian=True) @ right[index]
        if not len(index) or solution.min() >= 0:
            return solution
        alive[np.argmin(solution)] = False
