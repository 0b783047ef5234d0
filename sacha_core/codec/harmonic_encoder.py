"""Writing section `Harmonic`.

The basis is fitted, then prediction; then levels are chosen twice: by guessed bits, and by those of the tables that come of it.

Source: own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from sacha_core.codec.harmonic_basis import fit_transform
from sacha_core.codec.harmonic_choice import Problem, choose, pose
from sacha_core.codec.harmonic_contexts import N_CONTEXTS, ActivityPlan
from sacha_core.codec.harmonic_fitting import fit_activity
from sacha_core.codec.harmonic_metric import Metric
from sacha_core.codec.harmonics import GROUPS, TERMS, UNIT, WEIGHT_BITS, Neighbourhood, Transform
from sacha_core.codec.order import FULL_TRUST, MATES, Layout
from sacha_core.codec.steps import PER_OCTAVE, Classes, StepRule
from sacha_core.codec.symbols import SymbolWriter

__all__ = ["encode_harmonics"]

SQUARED_STEPS = 27.0  # of the picture's change by a step, for a bit: coarse steps and rare levels are cheapest
RIDGE = 0.01  # of the mean weight: draws what no camera sees towards nothing


def encode_harmonics(
    layout: Layout,
    sh_rest: Float[np.ndarray, "n k 3"],
    classes: Classes,
    rule: StepRule,
    metric: Metric,
    price: float | None = None,
) -> tuple[bytes, Float[np.ndarray, "n k 3"]]:
    """Code coefficients.

    Args:
        layout: where the Gaussians lie.
        sh_rest: coefficients of degree 1 and up, RGB.
        classes: what steps depend on.
        rule: step of a component that errors of degree 0 are worth as much as, in `UNIT`.
        metric: what errors are worth.
        price: change of the picture that a bit is worth elsewhere; the rule's steps are scaled to it. None takes the rule's steps.

    Returns:
        The section, and the coefficients as the decoder will have them.
    """
    rule, lagrangian = at_price(rule, classes, metric, price)
    transform = fit_transform(sh_rest, metric, rule, lagrangian)
    problem = pose(transform, sh_rest, metric, classes, lagrangian)
    neighbourhood = fit_neighbourhood(layout, problem, metric)
    levels, _ = choose(layout, problem, neighbourhood, None)
    problem, kept = problem.trimmed(levels)
    transform, neighbourhood, levels = (
        problem.transform,
        Neighbourhood(neighbourhood.weights[:, :, kept]),
        levels[:, kept],
    )
    plan = fit_activity(layout, levels, transform.rule, classes)
    tables = None
    if levels.size:
        tables = transform.activity(plan, classes), write(layout, levels, transform, plan, classes).level_bits()
    levels, values = choose(layout, problem, neighbourhood, tables)
    plan = fit_activity(layout, levels, transform.rule, classes)
    head = transform.pack() + neighbourhood.pack() + plan.pack()
    return head + write(layout, levels, transform, plan, classes).finish(), transform.coefficients(values)


def at_price(rule: StepRule, classes: Classes, metric: Metric, price: float | None) -> tuple[StepRule, float]:
    """Give the rule whose steps suit a price, and the price that suits its steps, or these steps where there is none."""
    if not len(metric.weight):
        return rule, 1.0
    cost = float((metric.weight * np.square(rule.steps(classes) * UNIT)).mean()) / SQUARED_STEPS
    if price is None:
        return rule, cost
    finer = round(PER_OCTAVE / 2 * np.log2(price / max(cost, 1e-30)))
    return rule.moved(finer), price


def fit_neighbourhood(layout: Layout, problem: Problem, metric: Metric) -> Neighbourhood:
    """Least-squares trust in neighbours and mates, by what errors are worth, from values that pictures would want."""
    transform = problem.transform
    n_components = len(transform.components)
    if not n_components:
        return Neighbourhood(np.zeros((GROUPS, TERMS, 0), np.int64))
    scale = np.einsum("nff->f", problem.quadratic) / max(metric.weight.sum(), 1e-30)
    ridge = np.diag(scale * RIDGE * metric.weight.mean()).astype(np.float32)
    wanted = np.linalg.solve(problem.quadratic + ridge, problem.linear)
    wanted = np.ascontiguousarray(wanted[:, transform.functions, transform.axis])
    normal = np.tile(np.eye(TERMS) * 1e-30, (GROUPS, n_components, 1, 1))
    right = np.zeros((GROUPS, n_components, TERMS))
    for step in layout.passes:
        group, weight = int(step.kind == MATES), metric.weight[step.rows, None].astype(np.float32)
        terms = [mean_of(wanted, step.near, step.trust), mean_of(wanted, step.mates, step.mate_trust)]
        for row, term in enumerate(terms):
            heavy = term * weight
            right[group, :, row] += (heavy * wanted[step.rows]).sum(axis=0)
            for column in range(row + 1):
                product = (heavy * terms[column]).sum(axis=0)
                normal[group, :, row, column] += product
                if column != row:
                    normal[group, :, column, row] += product
    solved = np.einsum("gctu,gcu->gct", np.linalg.pinv(normal, rcond=1e-6, hermitian=True), right)
    sent = np.clip(np.rint(solved * (1 << WEIGHT_BITS)), -127, 127).astype(np.int64)
    return Neighbourhood(np.moveaxis(sent, 2, 1))


def mean_of(
    values: Float[np.ndarray, "n c"], rows: Int[np.ndarray, "p k"], trust: Int[np.ndarray, "p k"]
) -> Float[np.ndarray, "p c"]:
    """Mean of the values at `rows` by trust."""
    total = np.zeros((len(rows), values.shape[1]), values.dtype)
    for column in range(rows.shape[1]):
        if trust[:, column].any():
            total += values[rows[:, column]] * (trust[:, column, None] / np.float32(FULL_TRUST))
    return total


def write(
    layout: Layout, levels: Int[np.ndarray, "n c"], transform: Transform, plan: ActivityPlan, classes: Classes
) -> SymbolWriter:
    """Write levels under their contexts."""
    activity = transform.activity(plan, classes)
    writer = SymbolWriter(N_CONTEXTS)
    for step in layout.passes:
        mine = levels[step.rows]
        writer.write(mine, activity.contexts(step))
        activity.learn(step, mine)
    return writer
