r"""Choosing and writing harmonics' levels.

What a Gaussian's levels are worth is judged together: the change of its pictures is a quadratic form of its components, so each level
makes up for the errors of the ones chosen before. A level is taken where it saves more of that than its bits cost.

Source: own; rate-distortion optimised quantisation, as in video encoders (Karczewicz et al., 2008), by coordinate descent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.codec.grouping import LevelBits
from sacha_core.codec.harmonic_basis import fit_transform, on_axes
from sacha_core.codec.harmonic_contexts import N_CONTEXTS, Activity, ActivityPlan
from sacha_core.codec.harmonic_fitting import fit_activity
from sacha_core.codec.harmonic_metric import Metric
from sacha_core.codec.harmonics import AXES, BASIS_ONE, GROUPS, TERMS, UNIT, WEIGHT_BITS, Neighbourhood, Transform
from sacha_core.codec.order import FULL_TRUST, MATES, Layout
from sacha_core.codec.steps import PER_OCTAVE, Classes, StepRule
from sacha_core.codec.symbols import SymbolWriter

__all__ = ["encode_harmonics"]

SQUARED_STEPS = 27.0  # of the picture's change by a step, for a bit: coarse steps and rare levels are cheapest
SWEEPS = 2
RIDGE = 0.01  # of the mean weight: draws what no camera sees towards nothing
ZERO_BITS, LEVEL_BITS, OCTAVE_BITS = 0.15, 3.5, 2.0  # of levels, before their tables are known
MAX_LEVEL = 200.0
FEWEST_LEVELS, ONE_IN = (
    10,
    500,
)  # of a component, of many Gaussians and of few: fewer do not pay for its function and weights


def guessed_bits(values: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Bits of levels before their tables are known: those of a typical table."""
    magnitude = np.abs(values)
    guess = LEVEL_BITS + OCTAVE_BITS * np.log2(np.maximum(magnitude, 1))
    return np.asarray(np.where(magnitude > 0, guess, ZERO_BITS))


@dataclass(frozen=True)
class Problem:
    """What is to be coded: the change of a Gaussian's pictures is $x^T A x - 2 h^T x$ of its components x on each axis, plus a constant.

    Args:
        transform: what components mean.
        quadratic: (n, f, f) A.
        linear: (n, f, 3) h.
        steps: (n, c) of components, in `UNIT`.
        lagrangian: squared change of the picture that a bit is worth.
    """

    transform: Transform
    quadratic: Float[np.ndarray, "n f f"]
    linear: Float[np.ndarray, "n f 3"]
    steps: Int[np.ndarray, "n c"]
    lagrangian: float

    def trimmed(self, levels: Int[np.ndarray, "n c"]) -> tuple[Problem, Bool[np.ndarray, " c"]]:
        """Leave out, axis by axis, the last functions with too few levels to be worth their bytes; tell which components stay."""
        used = np.count_nonzero(levels, axis=0) >= 1 + len(levels) // ONE_IN
        functions, axis = self.transform.functions, self.transform.axis
        counts = tuple(int((functions[(axis == a) & used] + 1).max(initial=0)) for a in range(AXES))
        most = max(counts)
        transform = replace(
            self.transform,
            counts=counts,
            basis=self.transform.basis[:most],
            exponents=self.transform.exponents[:most],
        )
        kept = functions < np.array(counts)[axis]
        quadratic, linear = self.quadratic[:, :most, :most], self.linear[:, :most]
        return Problem(transform, quadratic, linear, self.steps[:, kept], self.lagrangian), kept


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


def pose(
    transform: Transform, sh_rest: Float[np.ndarray, "n k 3"], metric: Metric, classes: Classes, lagrangian: float
) -> Problem:
    """State what is to be coded, in units of components."""
    n, k = len(sh_rest), transform.basis.shape[1]
    rows = np.ascontiguousarray((transform.basis / BASIS_ONE * UNIT).T.astype(np.float32))  # (k, f)
    seen = (metric.left.reshape(n * k, k) @ rows).reshape(n, k, rows.shape[1])
    turned = np.ascontiguousarray(seen.transpose(0, 2, 1))
    quadratic = (turned.reshape(n * rows.shape[1], k) @ rows).reshape(n, rows.shape[1], rows.shape[1])
    linear = turned @ on_axes(sh_rest, transform.axes).astype(np.float32)
    return Problem(transform, quadratic, linear, transform.steps(classes), lagrangian)


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


def choose(
    layout: Layout,
    problem: Problem,
    neighbourhood: Neighbourhood,
    tables: tuple[Activity, LevelBits] | None,
) -> tuple[Int[np.ndarray, "n c"], Int[np.ndarray, "n c"]]:
    """Choose all levels, by the bits of their tables or a guess; give them and the components as the decoder will have them."""
    levels, values = np.zeros(problem.steps.shape, np.int64), np.zeros(problem.steps.shape, np.int64)
    for step in layout.passes:
        rows, expected = step.rows, neighbourhood.predict(step, values)
        prices = (tables[1], tables[0].contexts(step)) if tables else None
        chosen = descend(problem, rows, expected, prices)
        if tables:
            tables[0].learn(step, chosen)
        levels[rows] = chosen
        values[rows] = expected + chosen * problem.steps[rows]
    return levels, values


def descend(
    problem: Problem,
    rows: Int[np.ndarray, " p"],
    expected: Int[np.ndarray, "p c"],
    prices: tuple[LevelBits, Int[np.ndarray, "p c"]] | None,
) -> Int[np.ndarray, "p c"]:
    """Choose the levels of a pass, one component after the other, and again with all others known."""
    transform = problem.transform
    quadratic, steps = problem.quadratic[rows], problem.steps[rows].astype(np.float64)
    curvature = np.maximum(np.einsum("pff->pf", quadratic), 1e-30)
    left = problem.linear[rows]  # less what the values so far explain
    for axis in range(AXES):
        mine = np.flatnonzero(transform.axis == axis)
        left[:, :, axis] -= np.einsum("pfg,pg->pf", quadratic[:, :, transform.functions[mine]], expected[:, mine])
    levels = np.zeros(expected.shape, np.int64)
    for _ in range(SWEEPS if prices else 1):
        for component, (function, axis) in enumerate(transform.components):
            step, before = steps[:, component], levels[:, component]
            gain = curvature[:, function] * step
            exact = np.clip(left[:, function, axis] / gain + before, -MAX_LEVEL, MAX_LEVEL)
            price = (prices[0], prices[1][:, component]) if prices else None
            best = cheapest(exact, gain * step, problem.lagrangian, price)
            moved = np.flatnonzero(best - before)
            change = (best - before)[moved] * step[moved]
            left[moved, :, axis] -= quadratic[moved, :, function] * change[:, None]
            levels[:, component] = best
    return levels


def cheapest(
    exact: Float[np.ndarray, " p"],
    worth: Float[np.ndarray, " p"],
    lagrangian: float,
    prices: tuple[LevelBits, Int[np.ndarray, " p"]] | None,
) -> Int[np.ndarray, " p"]:
    """Give the level of the least worth x (exact - level)^2 + lagrangian x bits: the nearest, the one below, or zero."""
    nearest = np.rint(exact).astype(np.int64)
    below = nearest - np.sign(nearest)
    best, least = nearest, np.full(len(exact), np.inf)
    for level in (nearest, below, np.zeros_like(nearest)):
        price = prices[0].of(level, prices[1]) if prices else guessed_bits(level)
        cost = worth * np.square(exact - level) + lagrangian * price
        best, least = np.where(cost < least, level, best), np.minimum(cost, least)
    return np.asarray(best)


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
